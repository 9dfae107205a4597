"""How much each named cause takes up of what the simulation gets wrong, and what remains."""

from collections.abc import Mapping, Sequence

import numpy as np

from femnl.core.diagnosis import FreeForm, Remainder, Share
from femnl.core.effect import Effect
from femnl.core.numbers import engineering, plain
from femnl.core.readout import Array
from femnl.diagnose.candidate import Candidate, Names, predict_held_out
from femnl.diagnose.thresholds import THRESHOLDS
from femnl.diagnose.worker_pool import Run
from femnl.fits.least_squares import FitResult, fit
from femnl.observe.extended import ExtendedModel

UNSEEN = 3.0
"""σ of a deviation that causes may leave, and that looks like noise."""


def shares(best: Candidate, found: Sequence[Candidate], run: Run) -> tuple[Share, ...]:
    """Return the share of each cause of a fitted set, the largest first.

    The excess of the base model is its held-out χ² beyond what noise adds. That is the number of
    data or, where the set leaves nothing but noise, what it leaves: the noise of thousands of data
    makes more or less of χ² than a weak cause does.

    Args: best: the set. found: what was fitted, the base model first. run: does the fits that held
    data out.
    """
    if not best.names:
        return ()
    base = found[0]
    known = {candidate.names: candidate.result for candidate in found}
    lacking = [without(best, base, (name,), known) for name in best.names]
    alone = [known.get((name,)) or _alone(best, base, name) for name in best.names]
    predict_held_out([*lacking, *alone], run)
    rest = [result.cross_validation for result in (*lacking, *alone)]
    before = base.result.cross_validation
    after = best.result.cross_validation
    only_noise = not _significant(best)
    whole = np.subtract(before.squares, after.squares if only_noise else after.sizes)
    unseen = UNSEEN**2 / max(float(whole.sum()), UNSEEN**2) if only_noise else 0.0
    told = []
    for k, name in enumerate(best.names):
        taken = np.subtract(rest[k].squares, after.squares)
        by_itself = np.subtract(before.squares, rest[len(best.names) + k].squares)
        sd = float(np.hypot(_error(taken, whole), unseen))
        told.append(Share(name, _part(taken, whole), sd, _part(by_itself, whole)))
    return tuple(sorted(told, key=lambda share: -share.share))


def _significant(best: Candidate) -> bool:
    """Whether a set of causes leaves more than noise."""
    return best.p_value < THRESHOLDS.set_inadequate


def _part(taken: Array, whole: Array) -> float:
    """Return a part of the whole excess, between 0 and 1."""
    total = float(whole.sum())
    return float(np.clip(taken.sum() / total, 0.0, 1.0)) if total > 0 else 0.0


def _error(taken: Array, whole: Array) -> float:
    """Return the standard deviation of a share over the blocks, by leaving out one at a time."""
    n = len(whole)
    if n < 2:
        return 1.0
    others = [_part(np.delete(taken, b), np.delete(whole, b)) for b in range(n)]
    return float(np.sqrt((n - 1) / n * np.sum((np.array(others) - np.mean(others)) ** 2)))


def without(
    best: Candidate, base: Candidate, names: Names, known: Mapping[Names, FitResult]
) -> FitResult:
    """Return the fit of a set without some of its causes.

    Args: known: fits that are at hand, by their causes.
    """
    left = tuple(other for other in best.names if other not in names)
    return known.get(left) or _fitted(best, base, [e for e in _effects(best) if e.name in left])


def _alone(best: Candidate, base: Candidate, name: str) -> FitResult:
    """Return the fit of one cause of a set beside the base model."""
    return _fitted(best, base, [e for e in _effects(best) if e.name == name])


def _effects(candidate: Candidate) -> tuple[Effect, ...]:
    return candidate.result.model.effects


def _fitted(best: Candidate, base: Candidate, kept: list[Effect]) -> FitResult:
    """Fit some causes of a set from where it has them; what the others replaced starts anew."""
    own, values = best.result.model.split(best.result.vector)
    plain_base, _ = base.result.model.split(base.result.vector)
    gone = {name for effect in _effects(best) for name in effect.replaces}
    start = own | {name: plain_base[name] for name in gone}
    numbers = [v for e, v in zip(_effects(best), values, strict=True) if e in kept]
    model = ExtendedModel(best.result.model.base_model, tuple(kept))
    return fit(model, model.pack(start, numbers), near=best.result)


def remainder(best: Candidate, base: Candidate, forms: Sequence[FreeForm]) -> Remainder:
    """Say what a set of causes leaves, where, and which free form describes it."""
    result = best.result
    seen = result.cross_validation
    where = result.model.base_model.describe(result.residuals)
    better = [form for form in forms if form.quality.heldout_chi2_reduced < seen.chi2_reduced]
    if better:
        after = better[0].quality.heldout_chi2_reduced
        gained = f"{plain(seen.chi2_reduced, 3)} → {plain(after, 3)}"
        where += (
            f"; {better[0].sentence} beside the causes predicts unseen data best "
            f"(held-out χ² per datum {gained})"
        )
    return Remainder(
        chi2_reduced=result.chi2 / result.degrees,
        heldout_chi2_reduced=seen.chi2_reduced,
        largest_sigma=float(np.abs(result.residuals).max()),
        in_units=_in_units(best, base),
        where=where,
        significant=_significant(best),
    )


def _in_units(best: Candidate, base: Candidate) -> str:
    """Return the largest deviation that is left, and the largest of the base model, with units."""
    model = best.result.model.base_model
    sizes, unit = model.quantity
    left, before = (
        float(np.nanmax(np.abs(model.deviations(candidate.result.residuals)) * sizes))
        for candidate in (best, base)
    )
    return f"{engineering(left, unit)} of {engineering(before, unit)}"
