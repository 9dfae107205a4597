"""How residuals change with a strength of an effect at zero."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from femnl.core.readout import Array

Index = NDArray[np.int64]
CHORD = 0.02
"""Part of its range at which the size of a strength is tried that has no slope at zero."""
LEAST = 1e-11
MOST = 0.01
"""Steps of a strength at zero, in parts of its range."""
FARTHEST = 10.0
TRIES = 5
"""Times by which the change that a step makes may miss its target, and how often one is sought."""


def tangents(
    change: Callable[[Index, Array], Array],
    count: int,
    step: float,
    high: float,
    target: float,
) -> tuple[Array, float]:
    """Return the derivatives of the residuals (count, n) by one strength at zero, a shape each.

    An effect that grows as the square of its strength has none there: the larger the misfit, the
    longer the secant. Where modes exchange labels at once no step does: the direction of the jump
    is returned, and other shapes do not begin with the step that sought it.

    Args: change: of the residuals (k, n) by a strength (k,) in some of the shapes (k,). step: where
        to begin. high: the largest strength. target: size of the change that a step makes.
    Returns: with them the step that did for the last shape for which one did, to begin others with.
    """
    steps = np.full(count, step)
    seeking = np.arange(count)
    reached = np.zeros(count, dtype=bool)
    slopes: dict[int, Array] = {}
    for _ in range(TRIES):
        used = steps[seeking]
        moved = change(seeking, used)
        size = np.linalg.norm(moved, axis=1)
        slopes |= dict(zip(seeking.tolist(), moved / used[:, None], strict=True))
        did = (size > target / FARTHEST) & (size < target * FARTHEST)
        reached[seeking[did]] = True
        factor = np.clip(target / np.maximum(size, 1e-300), 1e-4, 1e4)
        mended = np.clip(used * factor, LEAST * high, MOST * high)
        again = ~did & (mended != used)
        steps[seeking[again]] = mended[again]
        seeking = seeking[again]
        if not len(seeking):
            break
    others = float(steps[reached][-1]) if reached.any() else step
    return np.array([slopes[k] for k in range(count)]), others


def chord(change: Callable[[Index, Array], Array], low: float, high: float) -> Array:
    """Return the change of the residuals (n,) per strength at a finite strength, in one shape."""
    step = CHORD * (high - max(low, 0.0))
    return np.asarray(change(np.zeros(1, np.int64), np.array([step]))[0] / step)
