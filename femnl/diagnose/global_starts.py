"""Starts for an effect where tangents at zero lead astray.

Degenerate pairs that split, modes that exchange labels, poles.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.core.effect import Effect
from femnl.core.readout import Array
from femnl.diagnose.spread import spread
from femnl.fits.least_squares import FitResult
from femnl.observe.extended import ExtendedModel
from femnl.observe.model import MeasurementModel, scale_of

RAYS = 64
"""Directions in the space of an effect's parameters, and trial shapes."""
REACH = np.geomspace(1e-4, 1, 13)
"""Parts of the largest strengths at which rays are evaluated."""
COARSE = 3
BEST = 16
"""Every how many of those each ray is evaluated first, and of how many rays those beside the best
part are evaluated, too.
"""
STARTS = 6
"""Best rays."""
TRIED = 12
"""Places that are evaluated beside other causes, the best by what each cause does alone."""
BLIND = 1e-10
"""Part of the strongest direction in the model's parameters below which a direction does not show
in the data.
"""

PLACES = 24
"""Places at which an effect that has no strength is evaluated."""


@dataclass(frozen=True)
class Start:
    """Where a fit with one more effect may start.

    Base parameters, those of the effect, and the χ² that is promised there.
    """

    base: dict[str, float]
    values: dict[str, float]
    chi2: float


@dataclass(frozen=True)
class Seen:
    """Places all over the priors of one more effect, and what a model leaves there.

    numbers (m, n_parameters) of the effect, residuals (m, n), ray (m,): of the direction in the
    space of its parameters that a place lies on.
    """

    numbers: Array
    residuals: Array
    ray: NDArray[np.int64]


def scan(result: FitResult, effect: Effect) -> list[Start]:
    """Return the best starts with one more effect, best first, by its finite strengths along rays.

    χ² at each is that of the residuals beside the model's own tangents: its parameters follow as
    far as they do so linearly.
    """
    return _starts(result, effect, look_over(result, effect), STARTS)


def look_over(result: FitResult, effect: Effect) -> Seen:
    """Return what a model leaves with one more effect, over the whole range of its priors.

    The effect is tried coarsely along each ray, and then at every part of the best rays.
    """
    wider = ExtendedModel(result.model.base_model, (*result.model.effects, effect))
    low, high = (side[-len(effect.parameters) :] for side in wider.bounds)
    strengths = np.array([spec.strength for spec in effect.parameters])
    rays = _rays(effect, low, high)
    first = [(i, step) for i in range(len(rays)) for step in range(0, len(REACH), COARSE)]
    rough = _evaluated(result, effect, [_at(rays[i], step, strengths) for i, step in first])
    left = _promises(result, rough).reshape(len(rays), -1)
    best = left.argmin(axis=1) * COARSE
    promising = np.argsort(left.min(axis=1), kind="stable")[:BEST]
    beside = [
        (int(i), int(best[i]) + side)
        for i in promising
        for side in range(1 - COARSE, COARSE)
        if side != 0 and 0 <= best[i] + side < len(REACH)
    ]
    fine = _evaluated(result, effect, [_at(rays[i], step, strengths) for i, step in beside])
    places = [*first, *beside]
    return Seen(
        np.array([_at(rays[i], step, strengths) for i, step in places]),
        np.concatenate([rough, fine]),
        np.array([i for i, _ in places]),
    )


def scan_beside(result: FitResult, effect: Effect, base: FitResult, seen: Seen) -> list[Start]:
    """Return starts with one more effect, from what the base model leaves with that effect alone.

    What the causes of a model and one more do is added up, to find the few places that are
    evaluated.

    Args: base: the base model's fit. seen: what that leaves with the effect.
    """
    added = seen.residuals + result.residuals - base.residuals
    nearest = _best_of_rays(_promises(result, added), seen.ray)[:TRIED]
    numbers = seen.numbers[nearest]
    truly = Seen(numbers, _evaluated(result, effect, list(numbers)), seen.ray[nearest])
    return _starts(result, effect, truly, STARTS)


def _at(ray: Array, step: int, strengths: NDArray[np.bool_]) -> Array:
    """Return the values of an effect's parameters at a part of a ray."""
    return np.where(strengths, REACH[step] * ray, ray)


def _evaluated(result: FitResult, effect: Effect, places: list[Array]) -> Array:
    """Return the residuals (m, n) of a model with one more effect."""
    wider = ExtendedModel(result.model.base_model, (*result.model.effects, effect))
    base, values = result.model.split(result.vector)
    if not places:
        return np.empty((0, len(result.residuals)))
    vectors = [wider.pack(base, [*values, _named(effect, numbers)]) for numbers in places]
    return np.array(list(wider.residuals_of_each(np.array(vectors))))


def _named(effect: Effect, numbers: Array) -> dict[str, float]:
    return {spec.name: float(v) for spec, v in zip(effect.parameters, numbers, strict=True)}


def _own(result: FitResult) -> tuple[Array, Array]:
    """Return what a model's parameters can follow.

    Orthonormal directions (n, k) of residuals, and the way (p, k) that the parameters go for each.
    """
    width = np.subtract(*result.model.bounds[::-1])
    own, size, turned = np.linalg.svd(
        result.jacobian * np.where(result.free, width, 0), full_matrices=False
    )
    seen = size > BLIND * size[0]
    return own[:, seen], (turned[seen] / size[seen, None]).T * width[:, None]


def _promises(result: FitResult, residuals: Array) -> Array:
    """Return the χ² (m,) of residuals (m, n) beside the model's own tangents."""
    own, _ = _own(result)
    return np.asarray(np.sum(residuals**2, axis=1) - np.sum((residuals @ own) ** 2, axis=1))


def _best_of_rays(left: Array, ray: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the best place of each ray, best first."""
    order = np.argsort(left, kind="stable")
    _, first = np.unique(ray[order], return_index=True)
    return np.asarray(order[np.sort(first)])


def _starts(result: FitResult, effect: Effect, seen: Seen, most: int) -> list[Start]:
    """Return the starts at the best places, one a ray, best first."""
    own, back = _own(result)
    left = _promises(result, seen.residuals)
    starts = []
    for i in _best_of_rays(left, seen.ray)[:most]:
        moved = result.vector - back @ (own.T @ seen.residuals[i])
        near, _ = result.model.split(np.clip(moved, *result.model.bounds))
        starts.append(Start(near, _named(effect, seen.numbers[i]), float(left[i])))
    return starts


def centres(base_model: MeasurementModel, effect: Effect) -> list[dict[str, float]]:
    """Return values for an effect that has no strength: evenly over its priors."""
    steps = (np.arange(PLACES) + 0.5) / PLACES
    ranges = [
        (k.name, k.low * scale_of(base_model, k), k.high * scale_of(base_model, k))
        for k in effect.parameters
    ]
    return [{name: float(a + (b - a) * t) for name, a, b in ranges} for t in steps]


def _rays(effect: Effect, low: Array, high: Array) -> Array:
    """Return values of the parameters at full reach (n, n_parameters).

    Strengths in all directions, shapes all over their priors.
    """
    strengths = np.array([spec.strength for spec in effect.parameters])
    if strengths.all() and len(strengths) == 1:
        return np.array([[side] for side in (low[0], high[0]) if side != 0])
    parts = spread(RAYS, len(effect.parameters))
    placed = low + (high - low) * parts
    logs = np.array([spec.log for spec in effect.parameters])
    placed[:, logs] = low[logs] * (high[logs] / low[logs]) ** parts[:, logs]
    placed[:, [spec.whole for spec in effect.parameters]] = np.rint(
        placed[:, [spec.whole for spec in effect.parameters]]
    )
    return placed
