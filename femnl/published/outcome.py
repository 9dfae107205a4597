"""What femnl says of published measurements, beside the cause that their authors give."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any, Literal

from rich.table import Table
from rich.text import Text

from femnl.core.diagnosis import Diagnosis
from femnl.core.errors import FemnlError
from femnl.diagnose import diagnose
from femnl.io import measurement
from femnl.published.case import Case, external, find, load, to_measurement

HEADINGS = (
    "case",
    "authors' cause",
    "femnl's name",
    "verdict",
    "causes",
    "agreement",
    "leading set",
    "of χ²",
    "s",
)
"""Columns of the table: the leading set is that of highest evidence, named or not."""
Agreement = Literal[
    "the authors' cause",
    "the authors' cause and others",
    "one of the authors' causes",
    "among the alternatives",
    "another cause",
    "no cause",
    "no cause, as the authors",
    "refused",
    "no data",
]
"""How a diagnosis stands to the cause that the authors give."""


@dataclass(frozen=True)
class Outcome:
    """What femnl says of one case, beside its authors.

    shares: of each named cause, where the diagnosis gives them. leading: the set of causes of
    highest evidence among all that were tried, named or not. taken: the part of the base model's χ²
    that it takes up. message: why there is no verdict.
    """

    name: str
    title: str
    authors: str
    expected: tuple[str, ...]
    agreement: Agreement
    verdict: str = ""
    causes: tuple[str, ...] = ()
    shares: Mapping[str, float] | None = None
    probability: float | None = None
    leading: tuple[str, ...] = ()
    taken: float | None = None
    seconds: float = 0.0
    message: str = ""


def compare(case: Case, found: Diagnosis) -> Agreement:
    """Say how the causes of a diagnosis stand to those of the authors."""
    ours = set(found.causes)
    theirs = set(case.authors.names)
    if not theirs and found.verdict == "adequate":
        return "no cause, as the authors"
    if theirs and theirs == ours:
        return "the authors' cause"
    if theirs and theirs < ours:
        return "the authors' cause and others"
    if _among_alternatives(theirs, found):
        return "among the alternatives"
    if theirs & ours:
        return "one of the authors' causes"
    return "another cause" if ours else "no cause"


def _among_alternatives(theirs: set[str], found: Diagnosis) -> bool:
    """Whether a diagnosis holds the authors' causes to be as good as those that it gives.

    Only an ambiguous one does; others list sets that they hold to be less likely.
    """
    equal = found.alternatives if found.verdict == "ambiguous" else ()
    return bool(theirs) and any(theirs <= set(other.causes) for other in equal)


def run(
    folder: Path, select: Sequence[str] = (), data: Path | None = None, workers: int = 1
) -> Iterator[Outcome]:
    """Diagnose the cases of a folder one by one and yield each outcome as it comes.

    A case that femnl refuses, or whose data are not there, yields an outcome that says so.
    """
    for path in find(folder, select):
        yield _outcome(path.stem, load(path), data, workers)


def _outcome(name: str, case: Case, data: Path | None, workers: int) -> Outcome:
    """Diagnose one case."""
    begin = perf_counter()
    about = (name, case.title, case.authors.cause, tuple(case.authors.names))
    missing = external(case, data)
    if case.data.file and (missing is None or not missing.is_file()):
        return Outcome(*about, "no data", message=f"{case.data.file} is not there")
    try:
        with TemporaryDirectory() as scratch:
            file = Path(scratch) / f"{name}.nc"
            measurement.write(to_measurement(case, data), file)
            found = diagnose(file, workers=workers)
    except FemnlError as error:
        seconds = perf_counter() - begin
        return Outcome(*about, "refused", seconds=seconds, message=str(error))
    leading, taken = _leading(found)
    return Outcome(
        *about,
        agreement=compare(case, found),
        verdict=found.verdict,
        causes=found.causes,
        shares=_shares(found),
        probability=found.probability,
        leading=leading,
        taken=taken,
        seconds=perf_counter() - begin,
    )


def _shares(found: Diagnosis) -> dict[str, float] | None:
    """Return the share of each named cause, None where none is named."""
    return {one.cause: one.share for one in found.shares} or None


def _leading(found: Diagnosis) -> tuple[tuple[str, ...], float | None]:
    """Return the causes of highest evidence, and the part of the base model's χ² they take up."""
    base = [trial.chi2 for trial in found.trials if not trial.causes]
    tried = [trial for trial in found.trials if trial.causes]
    if not base or not tried:
        return (), None
    best = max(tried, key=lambda trial: trial.log_evidence)
    return best.causes, 1 - best.chi2 / base[0]


def record(outcome: Outcome) -> dict[str, Any]:
    """Return an outcome as plain values for JSON."""
    return asdict(outcome)


def render(outcomes: Sequence[Outcome]) -> Table:
    """Return a table of outcomes for the terminal, one line a case."""
    table = Table(title="Published cases", expand=False)
    for heading in HEADINGS:
        table.add_column(heading, overflow="fold")
    for outcome in outcomes:
        table.add_row(*(Text(cell) for cell in _cells(outcome)))
    return table


def _cells(outcome: Outcome) -> tuple[str, ...]:
    named = [_with_share(cause, outcome.shares) for cause in outcome.causes]
    return (
        outcome.name,
        outcome.authors,
        " + ".join(outcome.expected) or "–",
        outcome.verdict or outcome.message,
        " + ".join(named) or "–",
        outcome.agreement,
        " + ".join(outcome.leading) or "–",
        "–" if outcome.taken is None else f"{outcome.taken:.1%}",
        f"{outcome.seconds:.0f}",
    )


def _with_share(cause: str, shares: Mapping[str, float] | None) -> str:
    if shares is None or cause not in shares:
        return cause
    return f"{cause} ({shares[cause]:.1%})"
