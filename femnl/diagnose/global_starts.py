"""Starts for an effect where tangents at zero lead astray.

Degenerate pairs that split, modes that exchange labels, poles.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.stats.qmc import Sobol

from femnl.core.effect import Effect
from femnl.core.readout import Array
from femnl.fits.least_squares import FitResult
from femnl.observe.model import ExtendedModel, MeasurementModel, scale_of

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


def scan(result: FitResult, effect: Effect) -> list[Start]:
    """Return the best starts with one more effect, best first, by its finite strengths along rays.

    χ² at each is that of the residuals beside the model's own tangents: its parameters follow as
    far as they do so linearly.
    """
    wider = ExtendedModel(result.model.base_model, (*result.model.effects, effect))
    base, values = result.model.split(result.vector)
    low, high = (side[-len(effect.parameters) :] for side in wider.bounds)
    width = np.subtract(*reversed(result.model.bounds))
    own, size, turned = np.linalg.svd(
        result.jacobian * np.where(result.free, width, 0), full_matrices=False
    )
    seen = size > BLIND * size[0]
    own = own[:, seen]
    back = (turned[seen] / size[seen, None]).T * width[:, None]
    strengths = np.array([spec.strength for spec in effect.parameters])

    def promise(ray: Array, step: int) -> tuple[float, int, Array, Array]:
        numbers = np.where(strengths, REACH[step] * ray, ray)
        mine = {spec.name: float(v) for spec, v in zip(effect.parameters, numbers, strict=True)}
        residuals = wider.residuals(wider.pack(base, [*values, mine]))
        along = own.T @ residuals
        return float(residuals @ residuals - along @ along), step, numbers, along

    def best(ray: Array, steps: Iterable[int]) -> tuple[float, int, Array, Array]:
        return min((promise(ray, step) for step in steps), key=lambda t: t[0])

    rays = _rays(effect, low, high)
    rough = sorted(
        ((best(ray, range(0, len(REACH), COARSE)), ray) for ray in rays), key=lambda t: t[0][0]
    )
    found = []
    for first, ray in rough[:BEST]:
        beside = [
            first[1] + side
            for side in range(1 - COARSE, COARSE)
            if side != 0 and 0 <= first[1] + side < len(REACH)
        ]
        found.append(min(first, best(ray, beside), key=lambda t: t[0]))
    starts = []
    for promised, _, numbers, along in sorted(found, key=lambda t: t[0])[:STARTS]:
        near, _ = result.model.split(np.clip(result.vector - back @ along, *result.model.bounds))
        starts.append(
            Start(
                near,
                {spec.name: float(v) for spec, v in zip(effect.parameters, numbers, strict=True)},
                promised,
            )
        )
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
    parts = Sobol(len(effect.parameters), rng=np.random.default_rng(0)).random(RAYS)
    placed = low + (high - low) * parts
    logs = np.array([spec.log for spec in effect.parameters])
    placed[:, logs] = low[logs] * (high[logs] / low[logs]) ** parts[:, logs]
    placed[:, [spec.whole for spec in effect.parameters]] = np.rint(
        placed[:, [spec.whole for spec in effect.parameters]]
    )
    return placed
