"""What no known cause explains is measured all the same.

Extensions of free form, with the gain that each has on unseen data.
"""

from functools import partial

import numpy as np

from femnl.core.diagnosis import FreeForm, Quality
from femnl.diagnose.worker_pool import Job, Run, in_turn
from femnl.fits.least_squares import FitResult, fit, held_out
from femnl.observe.extended import ExtendedModel
from femnl.observe.free_forms import extensions

TOUCH = 0.01
"""Part of their bounds by which the numbers of a form are moved to see whether it moves the data at
all.
"""
ITERATIONS = 4
"""Iterations of the fits that leave a block out; they start at the whole fit."""


def free_forms(base: FitResult, run: Run = in_turn) -> tuple[FreeForm, ...]:
    """Fit every free form that suits the problem beside the causes of a fitted model.

    The best predicting comes first. run: does their fits.
    """
    sentences = dict.fromkeys(effect.sentence for effect in extensions(base.model.base_model))
    kind = base.model.base_model.kind
    found = run(
        [
            Job(f"{kind}: extending freely: {sentence}", partial(_measured, base, sentence))
            for sentence in sentences
        ]
    )
    return tuple(
        sorted(
            (form for form in found if form is not None),
            key=lambda form: form.quality.heldout_chi2_reduced,
        )
    )


def _measured(base: FitResult, sentence: str) -> FreeForm | None:
    result = _fitted(base, sentence)
    if result is None:
        return None
    effect = result.model.effects[-1]
    quality = Quality(result.chi2 / result.degrees, held_out(result, ITERATIONS))
    return FreeForm(effect.sentence, effect.equation, len(effect.parameters), quality)


def fitted_forms(base: FitResult) -> list[FitResult]:
    """Return the fit of every free form that suits a fitted model and moves its data.

    A form may have shorter and longer expansions. Only the one with the largest evidence is
    returned.
    """
    sentences = dict.fromkeys(effect.sentence for effect in extensions(base.model.base_model))
    return [result for sentence in sentences if (result := _fitted(base, sentence)) is not None]


def _fitted(base: FitResult, sentence: str) -> FitResult | None:
    """Return the fit of the form of a sentence, None where it does not move the data."""
    own, values = base.model.split(base.vector)
    best: FitResult | None = None
    for effect in (e for e in extensions(base.model.base_model) if e.sentence == sentence):
        model = ExtendedModel(base.model.base_model, (*base.model.effects, effect))
        start = model.pack(own, [*values, {spec.name: 0.0 for spec in effect.parameters}])
        moved = start.copy()
        moved[-len(effect.parameters) :] = TOUCH * model.bounds[1][-len(effect.parameters) :]
        if not np.array_equal(model.residuals(moved), model.residuals(start)):
            result = fit(model, start, near=base)
            if best is None or result.log_evidence > best.log_evidence:
                best = result
    return best
