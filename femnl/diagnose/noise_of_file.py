"""The noise of each measurement of a file, before causes are sought and after."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from femnl.core.checkpoint import Checkpoint
from femnl.core.diagnosis import Excluded, NoiseTold
from femnl.core.effect import Effect
from femnl.core.readout import Array
from femnl.diagnose.candidate import Candidate, scaled
from femnl.diagnose.criticism import criticise, is_adequate
from femnl.diagnose.joint import JointModel
from femnl.diagnose.noise import found_noise, standing_out
from femnl.diagnose.thresholds import THRESHOLDS
from femnl.fits.least_squares import FitResult, fit
from femnl.observe.extended import ExtendedModel
from femnl.observe.model import MeasurementModel
from femnl.observe.noisy import FoundNoise, with_noise, without_noise
from femnl.observe.residuals import Layout

Noise = Mapping[str, FoundNoise]
"""What was found of each measurement, by its name."""
LOOKS = 3
"""Times that a base model is fitted without the glitches found so far: a large one may hide others.
"""
FALLS_INTO_PLACE = 0.5
"""Part of the data that recur, more than which falls into place where glitches alone had moved the
fit. Of the points at jumps that a model misses, a fit without them moves one of two.
"""
SAME_FACTOR = 0.02
"""Relative difference of two factors, and difference of two correlations, up to which noise is the
same to every verdict.
"""
SAME_CORRELATION = 0.02


def first_noise(
    bare: MeasurementModel, library: list[Effect], checkpoint: Checkpoint | None
) -> FoundNoise:
    """Return the noise of one measurement that its base model shows.

    A misfit looks like noise in places, so that more noise than the file states, and correlation,
    count only where the base model explains the data with them; `last_noise` finds them elsewhere.
    Nor does correlated noise whose steps from datum to datum are far larger than stated noise: it
    describes any smooth misfit of data that are measured in coarse steps.
    """
    around = bare.layout or bare.sequence
    if around is None:
        return FoundNoise()

    def left(noise: FoundNoise) -> Array:
        """Return the residuals of all data, of a fit under some noise, in stated σ."""
        seen = with_noise(bare, noise)
        result = fit(ExtendedModel(seen), seen.start, checkpoint=checkpoint)
        base, _ = result.model.split(result.vector)
        return bare.residuals((), base, ())

    noise = _glitches_that_move_the_fit(left, around)
    for _ in range(LOOKS):
        residuals = left(noise)
        found = found_noise(residuals, around, noise)
        settled = found.glitches == noise.glitches
        noise = found
        if settled:
            break
    sure = FoundNoise(noise.glitches, 1.0 if noise.correlation else min(noise.factor, 1.0), 0.0)
    bare_noise = found_noise(residuals, around, noise, bare=True)
    for other in (noise, bare_noise):
        step = other.factor * np.sqrt(1 - other.correlation**2)
        if other == sure or (other.correlation and step > THRESHOLDS.largest_factor):
            continue
        seen = with_noise(bare, other)
        result = fit(ExtendedModel(seen), seen.start, checkpoint=checkpoint)
        if is_adequate(result, library):
            return other
    return sure


def _glitches_that_move_the_fit(left: Callable[[FoundNoise], Array], around: Layout) -> FoundNoise:
    """Return the glitches that a fit without them shows, where they had moved it; else none.

    A few large ones move a fit, and then much of the data near a resonance stands out in sweep
    after sweep. Without all that stands out it falls into place, but for the glitches. What a model
    lacks stays where it was.

    Args: left: residuals of all data, of a fit under some noise.
    """
    first = left(FoundNoise())
    outlying = standing_out(first, around)
    recurring = set(outlying.glitches) - set(found_noise(first, around, FoundNoise()).glitches)
    if not recurring:
        return FoundNoise()
    freed = left(outlying)
    still = recurring & set(standing_out(freed, around).glitches)
    moved = len({int(around.datum[i]) for i in recurring})
    placed = moved - len({int(around.datum[i]) for i in still})
    if placed <= FALLS_INTO_PLACE * moved:
        return FoundNoise()
    return found_noise(freed, around, FoundNoise())


def last_noise(best: Candidate, noise: Noise) -> Noise:
    """Return the noise of each measurement that the best set of causes shows.

    The noise from before stays where the new one differs by nothing that matters, and where what is
    left is too much for noise.
    """
    found = dict(noise)
    for name, (bare, residuals) in _bare_residuals(best.result).items():
        known = noise.get(name, FoundNoise())
        if bare.layout is None and _unexplained_but_noise(best, known):
            found[name] = FoundNoise(factor=best.factor)
            continue
        around = bare.layout or bare.sequence
        if around is None:
            continue
        # Anew: what stood out from a misfit may be none
        fresh = found_noise(residuals, around, FoundNoise(), bare=True, last=True)
        if bare.layout is None:  # an order tells the correlation alone
            fresh = replace(known, correlation=fresh.correlation)
        if fresh.factor <= THRESHOLDS.largest_factor and not _same(fresh, known):
            found[name] = fresh
    return found


def _unexplained_but_noise(best: Candidate, known: FoundNoise) -> bool:
    """Whether what causes leave looks like larger noise, of data without neighbours that tell it.

    No set explains the data within the stated noise, since the best one does not. Several causes
    that leave more than noise may imitate one that the library lacks. Of several measurements, a
    misfit does not tell whose noise is larger.
    """
    if (
        isinstance(best.result.model.base_model, JointModel)
        or len(best.names) != 1
        or best.viable
        or best.stuck
        or known != FoundNoise()
    ):
        return False
    if not 1 < best.factor <= THRESHOLDS.largest_factor:
        return False
    return criticise(scaled(best.result), []).p_value >= THRESHOLDS.base_inadequate


def told_noise(best: FitResult, noise: Noise, factor: float = 1.0) -> tuple[NoiseTold, ...]:
    """Return stated and found noise of each measurement, in its unit.

    factor: by which noise is larger that no neighbours tell.
    """
    told = []
    for name, (bare, _) in _bare_residuals(best).items():
        sizes, unit = bare.quantity
        used = float(np.nanmedian(sizes))
        stated = used / bare.noise_factor
        found = noise.get(name, FoundNoise())
        now = used * found.factor * factor
        length = max(found.correlation_length, bare.correlation_length)
        told.append(NoiseTold(name, stated, now, length, unit))
    return tuple(told)


def told_glitches(best: FitResult, noise: Noise) -> tuple[Excluded, ...]:
    """Return the data that were left out, the largest deviation first, each datum once."""
    told: list[Excluded] = []
    measured = _bare_residuals(best)
    for name, (bare, residuals) in measured.items():
        found = noise.get(name, FoundNoise())
        around = bare.layout
        label = f"{name}: " if len(measured) > 1 else ""
        told += [Excluded(label + where, sigma) for where, sigma in bare.left_out]
        if not found.glitches or around is None:
            continue
        away = np.abs(residuals) / found.factor
        largest: dict[int, int] = {}
        for i in found.glitches:
            datum = int(around.datum[i])
            if datum not in largest or away[i] > away[largest[datum]]:
                largest[datum] = i
        told += [Excluded(label + bare.locate(i), float(away[i])) for i in largest.values()]
    return tuple(sorted(told, key=lambda datum: -datum.sigma))


def _same(one: FoundNoise, other: FoundNoise) -> bool:
    close = abs(np.log(one.factor / other.factor)) < SAME_FACTOR
    alike = abs(one.correlation - other.correlation) < SAME_CORRELATION
    return one.glitches == other.glitches and bool(close) and alike


def _bare_residuals(result: FitResult) -> dict[str, tuple[MeasurementModel, Array]]:
    """Return each measurement's model under its stated noise, with its residuals in that."""
    base, values = result.model.split(result.vector)
    effects = result.model.effects
    model = result.model.base_model
    if not isinstance(model, JointModel):
        bare = without_noise(model)
        return {"": (bare, bare.residuals(effects, base, values))}
    found = {}
    for name, group in model.groups.items():
        bare = without_noise(group)
        found[name] = (bare, bare.residuals(*model.seen_by(name, effects, base, values)))
    return found
