"""One page for one diagnosis.

Verdict, data beside models, parameters, what was tried, how to reproduce it.
"""

import shlex
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from femnl.core.comparison import Comparison, Images
from femnl.core.contributions import Account, Contributions
from femnl.core.diagnosis import Diagnosis
from femnl.core.fit import Parameter
from femnl.core.numbers import engineering, plain, with_error
from femnl.io.results.atomic import write_whole
from femnl.plot.comparison import comparison_figure
from femnl.plot.contributions import contributions_figure
from femnl.report.picture import Picture, embed
from femnl.report.provenance import provenance

NAME = "report.html"
SHOWN = 15
"""Sets of causes that are listed, the best ones."""
MEANING = {
    "adequate": "The base model explains these data; no further cause is needed.",
    "explained": "This set of causes explains the data, and is clearly preferred to every other "
    "that was tried.",
    "explained in part": "These causes are beyond doubt. They take up most of what the base model "
    "gets wrong, and leave more than noise.",
    "ambiguous": "Several sets of causes explain these data equally well; the simplest is "
    "named first.",
    "unexplained": "The base model does not explain these data, and neither does any cause in "
    "the library.",
}


def write_diagnosis(diagnosis: Diagnosis, folder: Path) -> Path:
    """Write `report.html`, a page that needs no other file, into a folder that exists.

    Returns: its path.
    """
    loader = FileSystemLoader(Path(__file__).parent)
    environment = Environment(
        loader=loader,
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    ranked = sorted(diagnosis.trials, key=lambda trial: -trial.log_evidence)
    page = environment.get_template("diagnosis.html.j2").render(
        d=diagnosis,
        meaning=MEANING[diagnosis.verdict],
        numbers=[
            ("p-value of the base model", _p_value(diagnosis.p_value)),
            ("probability of the verdict", f"{diagnosis.probability:.3g}"),
            ("χ² per unseen datum, before", plain(diagnosis.before.heldout_chi2_reduced, 3)),
            ("χ² per unseen datum, after", plain(diagnosis.after.heldout_chi2_reduced, 3)),
            ("gain", plain(diagnosis.gain, 3)),
        ],
        pictures=[_picture(comparison) for comparison in diagnosis.comparisons],
        contributions=_contributions(diagnosis.contributions),
        parameters=_parameters(diagnosis),
        shares=[
            (
                s.cause,
                s.share,
                f"{100 * s.share:.5g} %",
                f"± {100 * s.sd:.2g} %",
                f"{100 * s.alone:.5g} %",
            )
            for s in diagnosis.shares
        ],
        noise=[
            [
                n.measurement or "–",
                plain(n.stated, 3),
                plain(n.found, 3),
                plain(n.correlation_length, 3),
                n.unit,
            ]
            for n in diagnosis.noise
        ],
        excluded=[[e.where, f"{e.sigma:.3g}"] for e in diagnosis.excluded[:SHOWN]],
        more_excluded=max(len(diagnosis.excluded) - SHOWN, 0),
        bounds=[
            [b.cause, b.name, plain(b.low, 3), plain(b.high, 3), _unit(b.unit), b.reason]
            for b in diagnosis.bounds
        ],
        trials=[
            [
                " + ".join(t.causes) or "base model",
                plain(t.chi2, 5),
                plain(t.log_evidence, 4),
                _p_value(t.p_value),
                "; ".join(t.against) or "nothing",
            ]
            for t in ranked[:SHOWN]
        ],
        more=max(len(ranked) - SHOWN, 0),
        forms=[
            [
                f.sentence,
                f.equation,
                f"{f.n_parameters}",
                *(plain(v, 4) for v in (f.quality.chi2_reduced, f.quality.heldout_chi2_reduced)),
            ]
            for f in diagnosis.free_forms
        ],
        command=shlex.join(
            [
                "femnl",
                "diagnose",
                diagnosis.file,
                *(("--geometry", diagnosis.geometry) if diagnosis.geometry else ()),
            ]
        ),
        provenance=provenance([]),
    )
    path = folder / NAME

    def save(file: Path) -> None:
        file.write_text(page, encoding="utf-8")

    write_whole(path, save)
    return path


@dataclass(frozen=True)
class _Told:
    """What causes change, for the page: what they are counted from, tables by title, pictures."""

    against: str
    tables: dict[str, list[list[str]]]
    pictures: list[Picture]


def _contributions(found: Contributions | None) -> _Told | None:
    if found is None:
        return None
    tables = {account.title: _terms(account) for account in found.accounts}
    return _Told(found.against, tables, [_contributed(shown) for shown in found.comparisons])


def _terms(account: Account) -> list[list[str]]:
    """Term, rms, largest with unit and in σ, where; the interaction where there can be one."""
    part = f"{plain(100 * account.interaction_part, 3)} % of the whole change"
    several = len(account.causes) > 1
    return [
        [
            f"{term.name} ({part})" if term is account.interaction else term.name,
            engineering(term.rms, account.unit),
            engineering(term.largest, account.unit),
            plain(term.largest_sigma, 3),
            term.where or "–",
        ]
        for term in account.terms
        if several or term is not account.interaction
    ]


def _contributed(comparison: Comparison) -> Picture:
    causes = " and ".join(comparison.models[2:])
    if isinstance(comparison, Images):
        words = f"Maps of what {causes} change of each harmonic, and what remains"
        caption = (
            "In the quadrature that holds most of it: the deviation from the model without any "
            "cause; what each cause changes, in the same colours; what remains in σ."
        )
    else:
        words = f"What {causes} change of {comparison.y} against {comparison.x}, and what remains"
        caption = (
            f"Deviation of the measured {comparison.y} from the model without any cause, and what "
            "each cause changes; underneath what remains in σ (grey: ±2σ)."
        )
    figure = contributions_figure(comparison)
    return embed(figure, words, f"{comparison.title}: {caption}")


def _p_value(p: float) -> str:
    return plain(p, 2) if p > 0 else "below 10⁻³⁰⁰"


def _parameters(diagnosis: Diagnosis) -> list[list[str]]:
    """Owner, name, value before and after, unit.

    The base parameters first, also those that a cause replaces.
    """
    after = diagnosis.parameters
    names = [
        *diagnosis.base_parameters,
        *(name for name in after["base"] if name not in diagnosis.base_parameters),
    ]
    rows = [
        ["base", name, _value(diagnosis.base_parameters.get(name)), _value(after["base"].get(name))]
        for name in names
    ]
    units = [(diagnosis.base_parameters.get(name) or after["base"][name]).unit for name in names]
    for owner, own in after.items():
        if owner != "base":
            rows += [[owner, name, "–", _value(p)] for name, p in own.items()]
            units += [p.unit for p in own.values()]
    return [[*row, _unit(unit)] for row, unit in zip(rows, units, strict=True)]


def _unit(unit: str) -> str:
    return "" if unit == "1" else unit


def _value(parameter: Parameter | None) -> str:
    return "–" if parameter is None else with_error(parameter.value, parameter.sd)


def _picture(comparison: Comparison) -> Picture:
    models = " and ".join(comparison.models)
    if isinstance(comparison, Images):
        caption = (
            "Each harmonic in the quadrature that holds its signal: measured; for each model "
            "what it predicts, in the same colours; and what it leaves in σ. White is zero; "
            "ranges are written at the left, those of what is left at the right."
        )
        words = f"Maps of the harmonics: measured, {models}, and what they leave"
    else:
        caption = (
            f"{comparison.y.capitalize()} against {comparison.x}: measured, as the models predict "
            "it, and what each of them leaves in σ (grey: ±2σ)."
        )
        words = f"{comparison.y} against {comparison.x}: measured, {models}, and what they leave"
    return embed(comparison_figure(comparison), words, f"{comparison.title}: {caption}")
