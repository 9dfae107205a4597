"""Numerical derivatives of residuals, with steps that suit any parameter.

Parameters that move different residuals share evaluations.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from femnl.core.readout import Array
from femnl.observe.extended import ExtendedModel

TARGET = 0.05
"""Change of the whole residual vector, in σ, at which tangents are taken."""
FIRST = 1e-6
LEAST = 1e-11
MOST = 0.01
"""Steps that are tried first, where nothing is known of them, and allowed at all, in parts of the
range.
"""
TRIES = 6
"""How often a step is mended."""


def tangents(model: ExtendedModel, vector: Array, at: Array, first: Array) -> tuple[Array, Array]:
    """Return a step for each parameter, and the derivatives of the residuals with it.

    A step changes the residuals by about `TARGET` in all.

    first: the steps that are tried first.
    """
    width = np.subtract(*model.bounds[::-1])
    steps = first.copy()
    slopes = np.zeros((len(at), vector.size))
    for place, mask in _lanes(model, at):
        seeking = np.ones(len(place), dtype=bool)
        for tries in range(TRIES, -1, -1):
            mine = place[seeking]
            own = mask[seeking]
            moved = _moved(model, vector, mine, steps[mine])
            change = np.where(own, model.residuals(moved) - at, 0.0)
            slopes[:, mine] = change.T / (moved - vector)[mine]
            size = np.linalg.norm(change, axis=1)
            again = (size <= 0.2 * TARGET) | (size >= 5 * TARGET)
            # A jump, as where two modes exchange labels, must not shrink the step to nothing.
            factor = np.where(again, np.clip(TARGET / np.maximum(size, 1e-300), 1e-4, 1e4), 1.0)
            mended = np.clip(steps[mine] * factor, LEAST * width[mine], MOST * width[mine])
            again &= mended != steps[mine]
            if not again.any() or not tries:
                break
            steps[mine[again]] = mended[again]
            seeking[seeking] = again
    return steps, slopes


def steps_for(model: ExtendedModel, size: Array, steps: Array | None = None) -> Array:
    """Return steps that change the residuals by about `TARGET`.

    They follow from the norms of the derivatives; where a norm is 0, the given step stays.
    """
    width = np.subtract(*model.bounds[::-1])
    steps = FIRST * width if steps is None else steps
    return np.asarray(
        np.where(
            size > 0, np.clip(TARGET / np.maximum(size, 1e-300), 1e-9 * width, MOST * width), steps
        )
    )


def jacobian_at(model: ExtendedModel, vector: Array, at: Array, steps: Array) -> Array:
    """Return the derivatives of the residuals, taken away from the nearer bound."""
    slopes = np.zeros((len(at), vector.size))
    for place, mask in _lanes(model, at):
        moved = _moved(model, vector, place, steps[place])
        change = model.residuals(moved) - at
        slopes[:, place] = np.where(mask, change, 0.0).T / (moved - vector)[place]
    return slopes


def _lanes(
    model: ExtendedModel, at: Array
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.bool_]]]:
    """Yield the places of parameters that can be moved together, and what each moves.

    The residuals are given as a mask (n_places, n).
    """
    left = {(owner, spec.name): i for i, (owner, spec) in enumerate(model.parameters)}
    for group in (
        ()
        if any(effect.couples_blocks for effect in model.effects)
        else model.base_model.independent_blocks
    ):
        masks = {
            left.pop(("base", name)): mask for name, mask in group.items() if ("base", name) in left
        }
        if masks:  # an effect may have replaced them all
            yield np.array(list(masks)), np.stack(list(masks.values()))
    for i in left.values():
        yield np.array([i]), np.ones((1, len(at)), dtype=bool)


def _moved(model: ExtendedModel, vector: Array, place: NDArray[np.int64], step: Array) -> Array:
    moved = vector.copy()
    moved[place] += np.where(vector[place] + step <= model.bounds[1][place], step, -step)
    return moved
