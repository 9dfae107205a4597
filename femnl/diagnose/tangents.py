"""Numerical derivatives of residuals, with steps that suit any parameter; parameters that move different residuals share evaluations."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from femnl.diagnose.problem import Extended
from femnl.types.readout import Array

TARGET = 0.05
"""Change of the whole residual vector, in σ, at which tangents are taken."""
FIRST, LEAST, MOST = 1e-6, 1e-11, 0.01
"""Steps that are tried first and allowed at all, in parts of the range."""
TRIES = 6


def tangent_steps(model: Extended, vector: Array, at: Array) -> Array:
    """Return for each parameter a step that changes the residuals by about `TARGET` in all."""
    width = np.subtract(*model.bounds[::-1])
    steps = np.empty(vector.size)
    for place, mask in _lanes(model, at):
        step, seeking = FIRST * width[place], np.ones(len(place), dtype=bool)
        for _ in range(TRIES):
            moved = _moved(model, vector, place[seeking], step[seeking])
            change = np.linalg.norm(np.where(mask[seeking], model.residuals(moved) - at, 0.0), axis=1)
            again = (change <= 0.2 * TARGET) | (change >= 5 * TARGET)
            seeking[seeking] = again
            if not again.any():
                break
            # A jump, as where two modes exchange labels, must not shrink the step to nothing.
            factor = np.clip(TARGET / np.maximum(change[again], 1e-300), 1e-4, 1e4)
            step[seeking] = np.clip(step[seeking] * factor, LEAST * width[place][seeking], MOST * width[place][seeking])
        steps[place] = step
    return steps


def steps_for(model: Extended, size: Array, steps: Array) -> Array:
    """Return steps that change the residuals by about `TARGET` where their derivatives have these norms, the given ones where none."""
    width = np.subtract(*model.bounds[::-1])
    return np.asarray(np.where(size > 0, np.clip(TARGET / np.maximum(size, 1e-300), 1e-9 * width, MOST * width), steps))


def jacobian_at(model: Extended, vector: Array, at: Array, steps: Array) -> Array:
    """Return the derivatives of the residuals, taken away from the nearer bound."""
    slopes = np.zeros((len(at), vector.size))
    for place, mask in _lanes(model, at):
        moved = _moved(model, vector, place, steps[place])
        change = model.residuals(moved) - at
        slopes[:, place] = np.where(mask, change, 0.0).T / (moved - vector)[place]
    return slopes


def _lanes(model: Extended, at: Array) -> Iterator[tuple[NDArray[np.int64], NDArray[np.bool_]]]:
    """Yield the places of parameters that can be moved together, and the residuals (n_places, n) that each of them moves."""
    left = {(owner, knob.name): i for i, (owner, knob) in enumerate(model.knobs)}
    for group in () if any(effect.across for effect in model.effects) else model.problem.apart:
        masks = {left.pop(("base", name)): mask for name, mask in group.items() if ("base", name) in left}
        if masks:  # an effect may have replaced them all
            yield np.array(list(masks)), np.stack(list(masks.values()))
    for i in left.values():
        yield np.array([i]), np.ones((1, len(at)), dtype=bool)


def _moved(model: Extended, vector: Array, place: NDArray[np.int64], step: Array) -> Array:
    moved = vector.copy()
    moved[place] += np.where(vector[place] + step <= model.bounds[1][place], step, -step)
    return moved
