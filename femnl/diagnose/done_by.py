"""What each cause of a fitted set does to the data."""

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from femnl.core.effect import Effect, Values
from femnl.core.readout import Array
from femnl.diagnose.candidate import Candidate
from femnl.diagnose.joint import JointModel
from femnl.observe.model import MeasurementModel
from femnl.observe.noisy import NoisyModel, without_noise


def effects_of(candidate: Candidate) -> tuple[Effect, ...]:
    """Return the causes of a fitted set."""
    return candidate.result.model.effects


def changed_by(candidate: Candidate, base: Candidate, effect: Effect) -> Array:
    """Return what one cause of a fitted set changes of every residual (n,).

    Its strengths at zero against their values; of a cause without strengths, the whole change from
    the base model.
    """
    result = candidate.result
    if not effect.has_strength:
        return np.asarray(base.result.residuals - result.residuals)
    effects = result.model.effects
    base_values, values = result.model.split(result.vector)
    without = idle(effects, values, (effect.name,))
    model = result.model.base_model
    return np.asarray(model.residuals(effects, base_values, without) - result.residuals)


def done_by(candidate: Candidate, base: Candidate, effect: Effect) -> Array:
    """Return what one cause changes of every residual (n,) that no base parameter could.

    A cause that acts strongly, and is balanced by parameters of the base model, may not miss the
    data the more for it. Of a cause without strengths, the base model is fitted already.
    """
    changed = changed_by(candidate, base, effect)
    if not effect.has_strength:
        return changed
    result = candidate.result
    of_base = np.array([owner == "base" for owner, _ in result.model.parameters])
    own, _ = np.linalg.qr(result.jacobian[:, of_base & result.free])
    return np.asarray(changed - own @ (own.T @ changed))


def done_by_each(candidate: Candidate, base: Candidate) -> list[Array]:
    """Return what each cause of a set does (`done_by`), less where causes undo each other.

    Of causes d₁, d₂, … each counts with min(1, |Σ d|/√(Σ |d|²)) in every quantity: what cancels may
    miss the data by no more than what is left of it. Causes that have nothing to do with each other
    count in full.
    """
    each = np.array([done_by(candidate, base, effect) for effect in effects_of(candidate)])
    if len(each) < 2:
        return list(each)
    for at in _quantities(candidate.result.model.base_model):
        apart = np.linalg.norm(each[:, at])
        together = np.linalg.norm(each[:, at].sum(axis=0))
        if together < apart:
            each[:, at] *= together / apart
    return list(each)


def _quantities(base_model: MeasurementModel) -> list[NDArray[np.bool_]]:
    """Return which residuals (n,) are of each quantity; all are of one in several measurements.

    What is no datum, as prior knowledge, counts with the first one.
    """
    bare = without_noise(base_model)
    if isinstance(bare, JointModel):
        return [np.ones(len(base_model.blocks), dtype=bool)]
    kept = base_model.kept if isinstance(base_model, NoisyModel) else slice(None)
    number = np.zeros(len(bare.blocks), dtype=int)
    for k, quantity in enumerate(bare.quantities):
        number[quantity.at] = k
    return [number[kept] == k for k in np.unique(number)]


def idle(
    effects: Sequence[Effect], values: Sequence[Values], names: Collection[str]
) -> list[Values]:
    """Return the parameters of effects with the strengths of the named ones at zero."""
    found: list[Values] = []
    for effect, own in zip(effects, values, strict=True):
        strengths = [spec.name for spec in effect.parameters if spec.strength]
        acts = effect.name not in names
        found.append(own if acts else {**own, **dict.fromkeys(strengths, 0.0)})
    return found
