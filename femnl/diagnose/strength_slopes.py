"""How residuals change with a strength of an effect at zero."""

from collections.abc import Callable

import numpy as np

from femnl.core.readout import Array

CHORD = 0.02
"""Part of its range at which the size of a strength is tried that has no slope at zero."""
LEAST = 1e-11
MOST = 0.01
"""Steps of a strength at zero, in parts of its range."""


def tangent(
    change: Callable[[float], Array],
    name: str,
    steps: dict[str, float],
    high: float,
    target: float,
) -> Array:
    """Return the derivative of the residuals by one strength at zero.

    The step that did is kept for the next shape.

    An effect that grows as the square of its strength has none there: the larger the misfit, the
    longer the secant. Where modes exchange labels at once no step does: the direction of the jump
    is returned, and other shapes do not begin with the step that sought it.

    Args: change: of the residuals by a strength. name: of the strength. steps: by name, where to
        begin; changed. high: the largest strength. target: size of the change that a step makes.
    """
    step = steps[name]
    for _ in range(5):
        moved = change(step)
        size = float(np.linalg.norm(moved))
        used = step
        if 0.1 < size / target < 10:
            steps[name] = used
            break
        step = float(
            np.clip(
                step * np.clip(target / max(size, 1e-300), 1e-4, 1e4), LEAST * high, MOST * high
            )
        )
        if step == used:
            break
    return np.asarray(moved / used)


def chord(change: Callable[[float], Array], low: float, high: float) -> Array:
    """Return the change of the residuals per strength at a finite strength."""
    step = CHORD * (high - max(low, 0.0))
    return np.asarray(change(step) / step)
