"""The measurement that best separates the sets of causes that are left."""

import numpy as np

from femnl.core.numbers import plain
from femnl.core.readout import Array
from femnl.diagnose.candidate import Candidate
from femnl.diagnose.verdict import Judgement

LEAST = 0.1
"""σ below which two explanations fit alike."""


def measure_next(judged: Judgement, found: list[Candidate]) -> str:
    """Name the measurement that best separates what is left, with the number of σ."""
    best = judged.chosen
    # What holds all named causes besides others is no other explanation
    others = [
        c
        for c in sorted(found, key=lambda c: (c.saturated, -c.weight))
        if c is not best and not (best.names and set(best.names) <= set(c.names))
    ]
    rivals = judged.rivals or tuple(others[:1])
    if not rivals and judged.verdict == "adequate":
        return (
            "nothing is left to separate: the base model explains these data and no "
            "extension was needed"
        )
    if not rivals:
        return "no cause of the library acts on these data: measure another quantity of this device"
    rival = rivals[0]
    one = " + ".join(best.names) or "the base model"
    other = " + ".join(rival.names) or "the base model"
    if judged.verdict == "explained":
        worse = float(np.sqrt(max(rival.result.chi2 - best.result.chi2, 0.0)))
        more = rival.result.vector.size - best.result.vector.size
        if worse < LEAST and more > 0:
            needed = "one more parameter" if more == 1 else f"{more} more parameters"
            return (
                f"nothing is left to separate: the next best explanation, {other}, takes {needed} "
                "to fit these data as well"
            )
        return (
            f"nothing is left to separate: the next best explanation, {other}, is "
            f"{plain(worse, 3)}σ worse on these data"
        )
    theirs = _predicted_measurements(rival)
    separation = {
        phrase: float(np.linalg.norm(predicted - theirs[phrase]))
        for phrase, predicted in _predicted_measurements(best).items()
    }
    phrase = max(separation, key=lambda key: separation[key])
    if separation[phrase] < 1:
        return (
            f"no further measurement of this kind separates {one} from {other} (at most "
            f"{separation[phrase]:.2g}σ): use another kind"
        )
    return f"measure {phrase}: it separates {one} from {other} by {plain(separation[phrase], 3)}σ"


def _predicted_measurements(
    candidate: Candidate,
) -> dict[str, Array]:
    model = candidate.result.model
    base, values = model.split(candidate.result.vector)
    return model.base_model.candidate_measurements(model.effects, base, values)
