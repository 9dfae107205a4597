"""What each named cause changes of every datum: the models with all causes, none, and all but one.

A cause is idle where its strengths are zero and all other parameters are as fitted. A cause without
strengths has no zero: without it, the model is the best fit of the others.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from femnl.core.comparison import Comparison, Images
from femnl.core.contributions import (
    IDLE,
    WHOLE,
    Account,
    Contributions,
    Term,
    contributed,
)
from femnl.core.effect import Effect
from femnl.core.readout import Array
from femnl.diagnose.candidate import Candidate, Names
from femnl.diagnose.done_by import idle
from femnl.diagnose.joint import JointModel, Own
from femnl.diagnose.shares import without
from femnl.fits.least_squares import FitResult
from femnl.observe.model import MeasurementModel, Named
from femnl.observe.noisy import FoundNoise, NoisyModel, without_noise
from femnl.observe.residuals import Quantity


def contributions(best: Candidate, found: Sequence[Candidate]) -> Contributions:
    """Return what each cause of a fitted set changes of every datum.

    Args: best: the set, with at least one cause. found: what was fitted, the base model first.
    """
    models = _models(best, found)
    needed = models[: max(_rows(best.names)) + 1]
    accounts = [
        account
        for one in _measurements(best.result.model.base_model, needed)
        for account in _accounts(one, best.names)
    ]
    shown = best.result.model.base_model.compare(needed)
    return Contributions(
        best.names,
        _against(best),
        tuple(accounts),
        tuple(_one_by_one(comparison, best.names) for comparison in shown),
    )


def _models(best: Candidate, found: Sequence[Candidate]) -> list[Named]:
    """Return the models with all causes, with none, and without each, in the order of the names."""
    known = {candidate.names: candidate.result for candidate in found}
    effects = best.result.model.effects
    own, values = best.result.model.split(best.result.vector)
    lasting = tuple(name for name in best.names if not _effect(best, name).has_strength)
    models: list[Named] = [(WHOLE, effects, own, values), _idle(best, found[0], lasting, known)]
    for name in best.names:
        if name in lasting:
            rest = without(best, found[0], (name,), known)
            models.append((name, rest.model.effects, *rest.model.split(rest.vector)))
        else:
            models.append((name, effects, own, idle(effects, values, (name,))))
    return models


def _effect(candidate: Candidate, name: str) -> Effect:
    return next(e for e in candidate.result.model.effects if e.name == name)


def _idle(
    best: Candidate, base: Candidate, lasting: Names, known: Mapping[Names, FitResult]
) -> Named:
    """Return the model without its causes, from which their contributions are counted.

    The causes have no effect in it. No value of their parameters switches off the causes in
    `lasting`, so that the model is then the best fit without those.
    """
    fit = without(best, base, lasting, known) if lasting else best.result
    own, values = fit.model.split(fit.vector)
    return IDLE, fit.model.effects, own, idle(fit.model.effects, values, best.names)


def _against(best: Candidate) -> str:
    lasting = [name for name in best.names if not _effect(best, name).has_strength]
    if not lasting:
        return "the fitted model with all causes at zero"
    rest = ", the other causes at zero" if len(lasting) < len(best.names) else ""
    return f"the best fit without {' and '.join(lasting)}{rest}"


@dataclass(frozen=True, eq=False)
class _Measurement:
    """One measurement: its name, its model under the stated noise, the noise that was found.

    residuals (n_models, n): deviations of each model, in stated σ.
    """

    name: str
    bare: MeasurementModel
    noise: FoundNoise
    residuals: Array


def _measurements(model: MeasurementModel, models: Sequence[Named]) -> Iterator[_Measurement]:
    """Return every measurement of a file; a single one has no name."""
    joint = model if isinstance(model, JointModel) else None
    groups = {"": model} if joint is None else joint.groups
    for name, group in groups.items():
        bare = without_noise(group)
        rows = []
        for _, effects, own, values in models:
            seen: Own = (effects, own, values)
            if joint is not None:
                seen = joint.seen_by(name, effects, own, values)
            rows.append(bare.deviations(bare.residuals(*seen)))
        noise = group.noise if isinstance(group, NoisyModel) else FoundNoise()
        yield _Measurement(name, bare, noise, np.stack(rows))


def _accounts(measured: _Measurement, names: tuple[str, ...]) -> Iterator[Account]:
    """Return the sum for each quantity of a measurement."""
    glitch = np.zeros(measured.residuals.shape[1], dtype=bool)
    glitch[list(measured.noise.glitches)] = True
    for quantity in measured.bare.quantities:
        # What a model leaves is what it predicts, counted from the data downwards
        left = measured.residuals[_rows(names)][:, quantity.at] * quantity.sd
        causes, together = contributed(-left)
        excluded = glitch[quantity.at]
        sd = quantity.sd * measured.noise.factor
        term = _Terms(measured.bare, quantity, sd, np.flatnonzero(~excluded))
        yield Account(
            measured.name,
            quantity.name,
            quantity.unit,
            quantity.coordinates,
            sd,
            excluded,
            term.of("deviation", left[1]),
            tuple(term.of(name, row) for name, row in zip(names, causes, strict=True)),
            term.of("interaction", together),
            term.of("remainder", left[0]),
        )


def _rows(names: tuple[str, ...]) -> list[int]:
    """Return where each model is among the computed ones: without its only cause a set is idle."""
    return [0, 1, 1] if len(names) == 1 else list(range(2 + len(names)))


@dataclass(frozen=True, eq=False)
class _Terms:
    """Makes terms of a quantity: where data are, their sd as found, and which are no glitches."""

    bare: MeasurementModel
    quantity: Quantity
    sd: Array
    kept: NDArray[np.int64]

    def of(self, name: str, values: Array) -> Term:
        """Return values (n,) with what is told of them."""
        seen = values[self.kept]
        if not np.any(seen):
            return Term(name, values, 0.0, 0.0, 0.0, "")
        at = int(self.kept[np.argmax(np.abs(seen))])
        return Term(
            name,
            values,
            float(np.sqrt(np.mean(seen**2))),
            float(values[at]),
            float(np.max(np.abs(seen / self.sd[self.kept]))),
            self.bare.locate(int(self.quantity.at[at])),
        )


def _one_by_one(comparison: Comparison, names: tuple[str, ...]) -> Comparison:
    """Return what is drawn, with a prediction for each model."""
    models = (WHOLE, IDLE, *names)
    if isinstance(comparison, Images):
        images = comparison.predictions[_rows(names)]
        return replace(comparison, models=models, predictions=images)
    curves = [
        replace(curve, predictions=curve.predictions[_rows(names)]) for curve in comparison.curves
    ]
    return replace(comparison, models=models, curves=tuple(curves))
