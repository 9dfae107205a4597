"""Numerical derivatives of residuals, with steps that suit any parameter.

Parameters that move different residuals share evaluations.
"""

import numpy as np
from numpy.typing import NDArray

from femnl.core.readout import Array
from femnl.observe.extended import ExtendedModel

Lane = tuple[NDArray[np.int64], NDArray[np.bool_]]
TARGET = 0.05
"""Change of the whole residual vector, in σ, at which tangents are taken."""
FIRST = 1e-6
LEAST = 1e-11
MOST = 0.01
"""Steps that are tried first, where nothing is known of them, and allowed at all, in parts of the
range.
"""
ROUNDED = 16
"""Least step in units of the last digit of a parameter: less may move it by nothing."""
TRIES = 6
"""How often a step is mended."""


def tangents(model: ExtendedModel, vector: Array, at: Array, first: Array) -> tuple[Array, Array]:
    """Return a step for each parameter, and the derivatives of the residuals with it.

    A step changes the residuals by about `TARGET` in all.

    first: the steps that are tried first.
    """
    width = np.subtract(*model.bounds[::-1])
    steps = first.copy()
    slopes = _room(vector, at)
    lanes = _lanes(model, at)
    for tries in range(TRIES, -1, -1):
        moved = _moved(model, vector, lanes, steps)
        left = []
        for (place, mask), there, residuals in zip(
            lanes, moved, model.residuals_of_each(moved), strict=True
        ):
            change = np.where(mask, residuals - at, 0.0)
            slopes[:, place] = change.T / (there - vector)[place]
            size = np.linalg.norm(change, axis=1)
            again = (size <= 0.2 * TARGET) | (size >= 5 * TARGET)
            # A jump, as where two modes exchange labels, must not shrink the step to nothing.
            factor = np.where(again, np.clip(TARGET / np.maximum(size, 1e-300), 1e-4, 1e4), 1.0)
            least = np.maximum(LEAST * width[place], ROUNDED * np.spacing(np.abs(vector[place])))
            mended = np.clip(steps[place] * factor, least, MOST * width[place])
            again &= mended != steps[place]
            if tries and again.any():
                steps[place[again]] = mended[again]
                left.append((place[again], mask[again]))
        lanes = left
        if not lanes:
            break
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
    slopes = _room(vector, at)
    lanes = _lanes(model, at)
    moved = _moved(model, vector, lanes, steps)
    found = model.residuals_of_each(moved)
    for (place, mask), there, residuals in zip(lanes, moved, found, strict=True):
        change = np.where(mask, residuals - at, 0.0)
        slopes[:, place] = change.T / (there - vector)[place]
    return slopes


def _room(vector: Array, at: Array) -> Array:
    """Return derivatives (n, p) of 0; those by one parameter lie side by side in memory.

    They are written and decomposed column by column, which in rows takes three times as long.
    """
    return np.zeros((vector.size, len(at))).T


def _lanes(model: ExtendedModel, at: Array) -> list[Lane]:
    """Return the places of parameters that can be moved together, and what each moves.

    The residuals are given as a mask (n_places, n).
    """
    left = {(owner, spec.name): i for i, (owner, spec) in enumerate(model.parameters)}
    lanes = []
    for group in (
        ()
        if any(effect.couples_blocks for effect in model.effects)
        else model.base_model.independent_blocks
    ):
        masks = {
            left.pop(("base", name)): mask for name, mask in group.items() if ("base", name) in left
        }
        if masks:  # an effect may have replaced them all
            lanes.append((np.array(list(masks)), np.stack(list(masks.values()))))
    everywhere = np.ones((1, len(at)), dtype=bool)
    return [*lanes, *((np.array([i]), everywhere) for i in left.values())]


def _moved(model: ExtendedModel, vector: Array, lanes: list[Lane], steps: Array) -> Array:
    """Return the vectors (n_lanes, p) in which the parameters of one lane each are moved."""
    moved = np.tile(vector, (len(lanes), 1))
    inwards = np.where(vector + steps <= model.bounds[1], steps, -steps)
    for row, (place, _) in zip(moved, lanes, strict=True):
        row[place] += inwards[place]
    return moved
