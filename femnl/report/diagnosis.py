"""One page for one diagnosis.

Verdict, data beside models, parameters, what was tried, how to reproduce it.
"""

import shlex
from dataclasses import dataclass
from pathlib import Path
from pkgutil import iter_modules

import femnl.effects
from femnl.core.comparison import Comparison, Images
from femnl.core.contributions import Account, Contributions
from femnl.core.diagnosis import Cause, Diagnosis, Share
from femnl.core.numbers import engineering, plain, with_error
from femnl.io.results.atomic import write_text_whole
from femnl.plot.comparison import comparison_figure
from femnl.plot.contributions import contributions_figure
from femnl.plot.quantiles import quantiles_figure
from femnl.report.parameters import bound_rows, correlations, parameter_rows
from femnl.report.picture import Picture, embed
from femnl.report.provenance import provenance
from femnl.report.template import template

NAME = "report.html"
SHOWN = 15
"""Sets of causes that are listed, the best ones."""
SITE = "https://femnl.github.io/femnl"
"""Where the documentation is published, with a page of each cause."""
DEFINITIONS = {
    "gain": "χ² per unseen datum of the base model, over that of the model with the causes named.",
    "share": "The part of the base model's excess χ² on unseen data that goes away when the cause "
    "is added to the other causes named. Alone: when it is added to the base model.",
    "unseen": "χ² per datum on blocks of data that the fit did not see, as tiles, drives, modes, "
    "sweeps or stretches of a series. It is 1 where only noise is left.",
    "p-value": "How often noise alone would look at least as bad for the base model, all tests of "
    "its residuals counted together.",
    "probability": "Posterior probability of these causes among all sets that were tried.",
    "evidence": "Logarithm of the probability of the data, averaged over the range of every "
    "parameter, times the prior odds of each cause, over that of the base model.",
}
"""What the words of the page mean, for who points at them."""
MEANING = {
    "adequate": "The base model explains these data; no further cause is needed.",
    "explained": "This set of causes explains the data, and is clearly preferred to every other "
    "that was tried.",
    "explained in part": "These causes are beyond doubt. They take up most of what the base model "
    "gets wrong, and leave more than noise.",
    "ambiguous": "These data do not decide between several sets of causes; the simplest is "
    "named first.",
    "unexplained": "The base model does not explain these data, and neither does any cause in "
    "the library.",
}


def write_diagnosis(diagnosis: Diagnosis, folder: Path) -> Path:
    """Write `report.html`, a page that needs no other file, into a folder that exists.

    Returns: its path.
    """
    ranked = sorted(diagnosis.trials, key=lambda trial: -trial.log_evidence)
    page = template("diagnosis.html.j2").render(
        d=diagnosis,
        meaning=MEANING[diagnosis.verdict],
        numbers=_numbers(diagnosis),
        means=DEFINITIONS,
        pictures=[_picture(comparison) for comparison in diagnosis.comparisons],
        quantiles=_quantiles(diagnosis),
        contributions=_contributions(diagnosis.contributions),
        explained=[(cause, _page(cause)) for cause in _described(diagnosis)],
        sets=_sets(diagnosis),
        parameters=parameter_rows(diagnosis),
        correlations=correlations(diagnosis.covariance),
        shares=[_share(s, alone=len(diagnosis.shares) > 1) for s in diagnosis.shares],
        noise=[
            [
                n.measurement or "–",
                engineering(n.stated, n.unit),
                engineering(n.found, n.unit),
                plain(n.correlation_length, 3),
            ]
            for n in diagnosis.noise
        ],
        excluded=[[e.where, f"{e.sigma:.3g}"] for e in diagnosis.excluded[:SHOWN]],
        more_excluded=max(len(diagnosis.excluded) - SHOWN, 0),
        bounds=bound_rows(diagnosis.bounds),
        trials=[
            [
                " + ".join(t.causes) or "base model",
                plain(t.chi2, 5),
                _evidence(t.log_evidence),
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
        provenance=provenance([] if diagnosis.model is None else [diagnosis.model]),
    )
    path = folder / NAME
    write_text_whole(path, page)
    return path


def _described(diagnosis: Diagnosis) -> tuple[Cause, ...]:
    """Return the causes of the verdict, and those of the sets that the data do not tell from it."""
    return (*diagnosis.explained, *(cause for rival in diagnosis.rivals for cause in rival.more))


def _sets(diagnosis: Diagnosis) -> list[tuple[tuple[str, ...], str]]:
    """Return the sets between which the data do not decide, each with its probability."""
    if not diagnosis.rivals:
        return []
    listed = [(diagnosis.causes, diagnosis.probability)]
    listed += [(rival.causes, rival.probability) for rival in diagnosis.rivals]
    return [(causes, plain(probability, 3)) for causes, probability in listed]


def _share(told: Share, *, alone: bool) -> tuple[str, float, str, str]:
    """Return cause, part, the part in percent with its error, and what it takes up alone.

    Args: alone: whether that is another number, as there are other causes.
    """
    size = f"{with_error(100 * told.share, 100 * told.sd, 2)} %"
    own = f"alone {plain(100 * told.alone, 3)} %" if alone else ""
    return told.cause, told.share, size.replace(" ± ", " % ± "), own


def _evidence(value: float) -> str:
    """Return ln evidence to a tenth, as sets of causes are told apart by its differences."""
    return f"{value + 0.0:,.1f}".replace(",", " ").replace("-", "−")


def _numbers(diagnosis: Diagnosis) -> list[tuple[str, str, str]]:
    """Return the numbers on top with their definitions.

    Without causes, there is no probability of them, and after is before.
    """
    before = plain(diagnosis.before.heldout_chi2_reduced, 3)
    p_value = ("p-value of the base model", _p_value(diagnosis.p_value), DEFINITIONS["p-value"])
    if not diagnosis.causes:
        return [p_value, ("χ² per unseen datum", before, DEFINITIONS["unseen"])]
    after = plain(diagnosis.after.heldout_chi2_reduced, 3)
    certain = diagnosis.probability >= 0.9995
    odds = "above 0.999" if certain else plain(diagnosis.probability, 3)
    return [
        p_value,
        ("probability of the verdict", odds, DEFINITIONS["probability"]),
        ("χ² per unseen datum, before", before, DEFINITIONS["unseen"]),
        ("χ² per unseen datum, after", after, DEFINITIONS["unseen"]),
        ("gain", plain(diagnosis.gain, 3), DEFINITIONS["gain"]),
    ]


def _quantiles(diagnosis: Diagnosis) -> Picture | None:
    """Draw what the verdict's model leaves; None where that is not known, as of old diagnoses."""
    if diagnosis.residuals is None:
        return None
    model = " + ".join(diagnosis.causes) or "the base model"
    caption = (
        f"What {model} leaves of the {diagnosis.residuals.size} data, in order of size, against "
        "normal numbers. Residuals that are noise lie in the grey band, 95 % of them."
    )
    words = f"Quantile plot of the residuals that {model} leaves"
    return embed(quantiles_figure(diagnosis.residuals), words, caption)


def _page(cause: Cause) -> str:
    """Return the address of the page on a cause; empty for one that is not femnl's own."""
    own = {found.name for found in iter_modules(femnl.effects.__path__)}
    return f"{SITE}/effects/{cause.name}.html" if cause.name in own else ""


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


def _picture(comparison: Comparison) -> Picture:
    models = " and ".join(comparison.models)
    if isinstance(comparison, Images):
        caption = (
            "Each harmonic in the quadrature that holds its signal: measured; for each model "
            "what it predicts, in the same colours; and what it leaves in σ. White is zero; "
            "ranges are written at the left, those of what is left at the right."
        )
        words = f"Maps of the harmonics: measured, {models}, and what they leave"
    elif comparison.ticks and not comparison.joined:
        caption = (
            f"{comparison.y.capitalize()} of each {comparison.x}: what is measured less what the "
            "models predict, and the same in σ (grey: ±2σ)."
        )
        words = f"Deviation of the {comparison.y} of each {comparison.x} from {models}"
    else:
        caption = (
            f"{comparison.y.capitalize()} against {comparison.x}: measured beside what the models "
            "predict, and what each of them leaves in σ (grey: ±2σ)."
        )
        words = f"{comparison.y} against {comparison.x}: measured, {models}, and what they leave"
    return embed(comparison_figure(comparison), words, f"{comparison.title}: {caption}")
