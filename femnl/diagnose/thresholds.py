"""What a diagnosis decides by: every threshold with its meaning and the study that set it."""

from dataclasses import dataclass, field, fields
from typing import TypeVar

T = TypeVar("T")


def _threshold(value: T, meaning: str, study: str) -> T:
    described: T = field(default=value, metadata={"meaning": meaning, "study": study})
    return described


_REALISTIC = "realistic regime in docs/explanation/blind.md"
_BLIND = "docs/explanation/blind.md"
_CALIBRATION = "tests/unit/test_diagnose_statistics.py"


@dataclass(frozen=True)
class Thresholds:
    """Thresholds of the search for causes and of the verdict; `explain` lists their meanings."""

    base_inadequate: float = _threshold(
        0.01,
        "p-value of the base model below which causes are sought",
        f"one false alarm in a hundred files by construction; counted in {_CALIBRATION}",
    )
    set_inadequate: float = _threshold(
        0.01,
        "p-value of all data, or of a block left out where a set has several causes, below which a "
        "set of causes does not explain them",
        "of single causes that the study left between 1e-3 and 1e-2, sixteen were imitations and "
        "six were true: docs/adr/0017-p-values.md",
    )
    chance_excluded: float = _threshold(
        1e-3,
        "p-value that is rare, but not too rare for chance: for the base model, and for what one "
        "cause predicts of a block that was left out",
        "docs/adr/0017-p-values.md",
    )
    set_doubtful: float = _threshold(
        0.05,
        "p-value below which a set that explains the data may lack a cause too weak to rule it out",
        "docs/adr/0020-indistinguishable-sets.md",
    )
    named_alone: float = _threshold(
        0.99,
        "posterior probability from which on one set of causes is named alone",
        "a wrong one in less than one of a hundred files: docs/adr/0018-naming-at-99-percent.md",
    )
    even_odds: float = _threshold(
        19.0,
        "odds up to which a set is no less likely than another, for all that is known of priors",
        "docs/adr/0018-naming-at-99-percent.md and docs/adr/0019-occam-factor-of-free-forms.md",
    )
    equal_chi2: float = _threshold(
        4.0,
        "difference in χ² up to which a set with no more parameters does as well, whatever the "
        "widths of the priors",
        "two standard deviations of one parameter; rates in " + _BLIND,
    )
    contradicting_errors: float = _threshold(
        2.0,
        "standard errors by which a rival's log density of held-out data must exceed the best "
        "set's to contradict the evidence",
        "docs/adr/0021-prediction-against-evidence.md",
    )
    largest_scatter: float = _threshold(
        1e3, "largest deviations of unknown cause that are allowed for, in σ", _BLIND
    )
    odds_per_cause: float = _threshold(0.1, "prior odds of one more cause", _BLIND)
    clear_odds: float = _threshold(
        3.0,
        "odds by which a named set of causes must be likelier than the base model, even where that "
        "leaves too much for chance (docs/adr/0045-likelier-than-the-base.md), and from which on a "
        "likelier cause that predicts a block badly keeps a set from being named alone "
        "(docs/adr/0046-likelier-and-badly-predicted.md)",
        _REALISTIC,
    )
    most_rivals: int = _threshold(
        3, "rivals of the best set whose held-out prediction is computed", _BLIND
    )
    most_effects: int = _threshold(
        7, "effects that are fitted beside others, those that the residuals point to most", _BLIND
    )
    fewest_effects: int = _threshold(4, "effects that are fitted beside others in any case", _BLIND)
    least_gain: float = _threshold(
        0.01, "part of the excess of χ² that any other effect must promise to take up", _BLIND
    )
    least_taken: float = _threshold(
        8.0,
        "what a cause must take of χ² to be extended where tangents tell what causes take: less is "
        "not worth its parameters",
        _BLIND,
    )
    far_off: float = _threshold(
        5.0,
        "root of χ² per degree of freedom of the base model from which on single effects are "
        "sought by rays, too: tangents do not tell where strong causes lead, as a filter that lags",
        _REALISTIC,
    )
    surprising_effects: int = _threshold(
        2,
        "effects whose score tests are the least likely by chance, fitted whatever they promise: a "
        "test of second order shows that an effect is there, not how much it takes up",
        _BLIND,
    )
    beam: int = _threshold(2, "sets of causes that are extended at each step", _BLIND)
    peer_ratio: float = _threshold(
        2.0,
        "ratio of what a single cause and the best one leave of χ², up to which it is extended too",
        _BLIND,
    )
    nearly_explained: float = _threshold(
        0.01,
        "part of what the base model leaves beyond noise, up to which a set beside one that "
        "explains the data is fitted anew: it may equal it",
        _BLIND,
    )
    wrong_noise_odds: float = _threshold(
        0.02,
        "prior odds that a stated standard deviation is too small, where no neighbours tell the "
        "noise",
        _REALISTIC,
    )
    most_refitted: int = _threshold(
        12,
        "sets that are fitted again where the best one explains the data and shows other noise "
        "than was known",
        _REALISTIC,
    )
    largest_factor: float = _threshold(
        3.0, "noise over the stated one up to which a misfit may be noise alone", _REALISTIC
    )
    factor_spread: float = _threshold(
        0.5,
        "standard deviation of the logarithm of noise over the stated one, where that is wrong",
        _REALISTIC,
    )
    mostly_explained: float = _threshold(
        0.5,
        "part of what the base model leaves beyond noise, below which what one cause leaves may be "
        "noise that differs from the stated one",
        _REALISTIC,
    )
    little_left: float = _threshold(
        1e-3,
        "part of what the base model leaves beyond noise, below which no start from afar and no "
        "set of three is tried: what is left then is for the accuracy of equations",
        _REALISTIC,
    )
    least_share_each: float = _threshold(
        0.05,
        "part of the excess χ² of all data that each of several causes must take up beside the "
        "others to be named where they leave a significant remainder: less is within what "
        "equations miss",
        _REALISTIC,
    )
    least_share_of_rest: float = _threshold(
        0.78,
        "part of what the others of several causes leave beyond noise that each must take up to be "
        "named where they leave a significant remainder: beside something unknown, a slope took up "
        "0.58 of what a drive that does not follow left",
        _REALISTIC,
    )
    least_share: float = _threshold(
        0.9,
        "part of the held-out excess χ² that causes must take up to be named where they leave a "
        "significant remainder",
        _REALISTIC,
    )
    least_share_of_unlike: float = _threshold(
        0.78,
        "the least part that is asked of a single cause that imitates none which was not "
        "considered: beside something unknown of half its size, a cause takes up 0.8: "
        "docs/adr/0047-shares-by-what-a-cause-imitates.md",
        _REALISTIC,
    )
    needless_odds: float = _threshold(
        1e3,
        "odds, with a discrepancy in every set, by which fewer causes must be likelier than a set "
        "that explains the data within noise before its further causes are needless; and odds by "
        "which that set must be likelier, where only equations may be inexact, before they are "
        "named: docs/adr/0039-further-causes-and-inexact-equations.md",
        _REALISTIC,
    )
    least_share_of_alike: float = _threshold(
        0.99,
        "the same where smooth directions span much of the data, as of a spectrum, and in maps, "
        "decays and traces: "
        "there one smooth cause takes up most of another, a compliant clamp 97 % of a yielding "
        "edge in tests/physics/test_yielding_edge.py, an admixture of modes 98 % of a drift in "
        "tests/unit/test_diagnose_map_causes.py; in decays a stiffness that grows with amplitude "
        "90 to 96 % of a drift, in traces a slow detector 97 to 98 % of a trigger's jitter; in "
        "sweeps what equations may miss is left: a slope takes up 98 % of a Fano line, a second "
        "mode 97 % of a quintic stiffness, but one law of a drive that does not follow, or of a "
        "detector that clips, 99 % of another, and that is to be named",
        _REALISTIC,
    )
    few_data: float = _threshold(
        1 / 3,
        "part of the data that smooth directions span, from which on one smooth cause resembles "
        "another: 0.45 of frequencies with quality factors, at most 0.27 of twenty series",
        _REALISTIC,
    )
    least_inclusion: float = _threshold(
        0.99,
        "posterior probability that a cause is part of the right set, with a discrepancy of "
        "unknown size in every set, from which on it is beyond doubt",
        _REALISTIC,
    )
    least_inclusion_of_alike: float = _threshold(
        0.999,
        "the same where one smooth cause resembles another: unequal stress beside a gradient took "
        "up 0.99997 of a yielding edge that the library lacked, with odds of 195 to unequal sides",
        _REALISTIC,
    )
    most_blocks: float = _threshold(
        0.7,
        "part of the data in blocks whose held-out prediction a named set must improve",
        _REALISTIC,
    )
    pairs_tried: int = _threshold(
        12, "pairs fitted from afar that are brought nearer, by what each cause does alone", _BLIND
    )
    sought_again: tuple[int, ...] = _threshold(
        (3, 3, 1),
        "sets of one, two and three causes that are sought anew, or pairs that are fitted from "
        "afar, where no set explains the data beyond doubt",
        _BLIND,
    )


def explain(thresholds: Thresholds) -> list[tuple[str, object, str, str]]:
    """Return name, value, meaning and study of every threshold."""
    return [
        (one.name, getattr(thresholds, one.name), one.metadata["meaning"], one.metadata["study"])
        for one in fields(thresholds)
    ]


THRESHOLDS = Thresholds()
