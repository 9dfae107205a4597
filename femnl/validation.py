"""Cases that hold femnl to numbers from elsewhere.

One file each in validation/, discovered, never listed.

To add one, put a Python file into validation/ that defines CASE; its name is the name of the case.
Nothing else is edited.

    from femnl.validation import Case, Reference

    def compute():
        modes = femnl.solve_modes(femnl.load("square-270um"), count=2)
        yield modes.ratio[1], modes.ratio_error[1]       # value and femnl's own error bound; or the
        value alone

    CASE = Case(
        claim="An ideal square membrane rings at √(m² + n²)",
        source="closed form: sin(mπx/L) sin(nπy/L) in c²Δw = ẅ",
        references=(Reference("f(2,1)/f(1,1)", 2.5**0.5, relative=1e-6),),
        compute=compute,
    )

`references` lists the numbers in the order in which `compute` yields its own. A reference never is
a number that femnl printed. An erratum also gives `printed`, what the source says, and `why` it is
wrong: the case then shows that the two differ. `slow=True` keeps a case of more than a few seconds
out of `make test`; `femnl validate` runs it all the same.
"""

import importlib.util
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from fnmatch import fnmatch
from pathlib import Path
from time import perf_counter
from typing import Any, Literal, TypeVar

from rich.table import Table
from rich.text import Text

from femnl.core.errors import ParameterError

Values = Iterable[float | tuple[float, float]]
SIGMAS = 3.0
T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True)
class Reference:
    """One number from elsewhere, and how closely femnl has to meet it.

    Exactly one of: relative, the greatest |value/reference − 1|; absolute, the greatest |value −
    reference|, in `unit`; sd, the reference's own standard deviation, in `unit`, of which the
    difference may be three. printed: the wrong number of an erratum, which the value has to miss by
    more than the tolerance.
    """

    quantity: str
    value: float
    unit: str = ""
    relative: float | None = None
    absolute: float | None = None
    sd: float | None = None
    printed: float | None = None

    def __post_init__(self) -> None:
        given = [limit for limit in (self.relative, self.absolute, self.sd) if limit is not None]
        if len(given) != 1 or not 0 < given[0] < math.inf:
            raise ParameterError(
                f"reference {self.quantity!r}: give one positive tolerance, relative, absolute "
                f"or sd, not {given}"
            )

    @property
    def tolerance(self) -> float:
        """The greatest |value − reference|, in `unit`."""
        if self.relative is not None:
            return self.relative * abs(self.value)
        return self.absolute if self.absolute is not None else SIGMAS * (self.sd or 0.0)


@dataclass(frozen=True)
class Case:
    """A claim, the numbers that decide it, where they are from, and how femnl computes its own."""

    claim: str
    source: str
    references: tuple[Reference, ...]
    compute: Callable[[], Values]
    why: str = ""
    slow: bool = False

    def __post_init__(self) -> None:
        for field in ("claim", "source", "references"):
            if not getattr(self, field):
                raise ParameterError(
                    f"case {self.claim!r}: {field} is empty; a case says what it claims, by "
                    "which numbers, from where"
                )
        if any(reference.printed is not None for reference in self.references) and not self.why:
            raise ParameterError(
                f"case {self.claim!r}: `why` is empty; an erratum says why the printed number "
                "is wrong"
            )


@dataclass(frozen=True)
class Row:
    """One reference beside femnl's value, whose error bound is `error` (None: none)."""

    reference: Reference
    value: float
    error: float | None = None

    @property
    def difference(self) -> float:
        """Value − reference, in the reference's unit."""
        return self.value - self.reference.value

    @property
    def verdict(self) -> Literal["agrees", "differs", "printed number stands"]:
        """Whether the value meets the reference, and misses the printed number of an erratum."""
        reference = self.reference
        if not abs(self.difference) <= reference.tolerance:
            return "differs"
        if (
            reference.printed is not None
            and not abs(self.value - reference.printed) > reference.tolerance
        ):
            return "printed number stands"
        return "agrees"

    @property
    def distance(self) -> str:
        """The difference in words.

        In σ where the reference has one, else in ppm, or in its unit about zero.
        """
        if self.reference.sd is not None:
            return f"{self.difference / self.reference.sd:+.2g} σ"
        if self.reference.value != 0:
            ppm = self.difference / abs(self.reference.value) * 1e6
            return f"{ppm:+,.0f} ppm" if abs(ppm) >= 1000 else f"{ppm:+.3g} ppm"
        return f"{self.difference:+.3g} {self.reference.unit}".strip()


@dataclass(frozen=True)
class Result:
    """What running one case gave; `failure` says what stopped it, None where nothing did."""

    name: str
    claim: str
    source: str
    why: str
    rows: tuple[Row, ...]
    seconds: float
    failure: str | None = None

    @property
    def passed(self) -> bool:
        """Whether it ran to the end and every row agrees."""
        return self.failure is None and all(row.verdict == "agrees" for row in self.rows)


def find(folder: Path, select: Sequence[str] = ()) -> list[Path]:
    """Return the case files of a folder by name.

    `select` keeps the names that match one of its words, wildcards allowed.

    Raises: ParameterError where a word matches no case.
    """
    paths = sorted(path for path in folder.glob("*.py") if not path.name.startswith("_"))
    for word in select:
        if not any(fnmatch(path.stem, word) for path in paths):
            raise ParameterError(
                f"no validation case is named {word!r}; there are: "
                f"{', '.join(path.stem for path in paths)}"
            )
    return [
        path for path in paths if not select or any(fnmatch(path.stem, word) for word in select)
    ]


def load(path: Path) -> Case:
    """Return the case that a file defines.

    Raises: ParameterError where the file defines none.
    """
    spec = importlib.util.spec_from_file_location(f"femnl_validation_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ParameterError(f"{path}: not a Python file")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    case = getattr(module, "CASE", None)
    if not isinstance(case, Case):
        raise ParameterError(
            f"{path}: defines no CASE; set CASE = Case(…), see femnl/validation.py"
        )
    return case


def compare(case: Case) -> tuple[Row, ...]:
    """Compute a case and put each value beside its reference.

    Raises: ParameterError where it computes more or fewer values than it has references; whatever
    the computation raises.
    """
    values = list(case.compute())
    if len(values) != len(case.references):
        raise ParameterError(
            f"case {case.claim!r}: {len(values)} values for {len(case.references)} references; "
            "they go one to one"
        )
    pairs = [value if isinstance(value, tuple) else (value, None) for value in values]
    return tuple(
        Row(reference, float(value), None if error is None else float(error))
        for reference, (value, error) in zip(case.references, pairs, strict=True)
    )


def run(folder: Path, select: Sequence[str] = ()) -> Iterator[Result]:
    """Run the cases of a folder one by one and yield each result as it comes.

    a case that breaks yields a failed result.
    """
    for path in find(folder, select):
        start = perf_counter()
        case, failure = _attempt(load, path)
        if case is None:
            yield Result(path.stem, "cannot be read", "", "", (), perf_counter() - start, failure)
            continue
        rows, failure = _attempt(compare, case)
        yield Result(
            path.stem,
            case.claim,
            case.source,
            case.why,
            rows or (),
            perf_counter() - start,
            failure,
        )


def _attempt(action: Callable[[T], R], argument: T) -> tuple[R | None, str | None]:
    # A future keeps whatever the action raises, so that one broken case hides neither the others
    # nor itself.
    with ThreadPoolExecutor(1) as executor:
        future = executor.submit(action, argument)
        raised = future.exception()
    return (
        (None, f"{type(raised).__name__}: {raised}")
        if raised is not None
        else (future.result(), None)
    )


def record(result: Result) -> dict[str, Any]:
    """Return a result as plain values for JSON, with every row's difference spelt out."""
    rows = [
        {
            "quantity": row.reference.quantity,
            "unit": row.reference.unit,
            "value": row.value,
            "error": row.error,
            "reference": row.reference.value,
            "tolerance": row.reference.tolerance,
            "sd": row.reference.sd,
            "printed": row.reference.printed,
            "difference": row.difference,
            "verdict": row.verdict,
        }
        for row in result.rows
    ]
    return asdict(result) | {"rows": rows, "passed": result.passed}


def render(results: Sequence[Result]) -> Table:
    """Return a table of results for the terminal.

    One section a case, one line a number, failures in red.
    """
    failed = sum(not result.passed for result in results)
    seconds = sum(result.seconds for result in results)
    table = Table(
        caption=f"{failed} of {len(results)} failed, {seconds:.1f} s",
        title="Validation",
        expand=False,
    )
    table.add_column("quantity", overflow="fold")
    for heading in ("femnl", "± error", "reference", "printed", "difference"):
        table.add_column(heading, justify="right", overflow="fold")
    table.add_column("verdict", overflow="fold")
    for result in results:
        style = "" if result.passed else "red"
        table.add_section()
        table.add_row(Text(f"{result.name}: {result.claim}", style=f"bold {style}".strip()))
        if result.failure is not None:
            table.add_row(
                Text(result.failure, style="red"), "", "", "", "", "", Text("broken", style="red")
            )
        for row in result.rows:
            table.add_row(*_cells(row), style="" if row.verdict == "agrees" else "red")
    return table


def _cells(row: Row) -> tuple[Text, ...]:
    reference = row.reference
    name = (
        f"  {reference.quantity} [{reference.unit}]"
        if reference.unit
        else f"  {reference.quantity}"
    )
    error = "" if row.error is None else f"{row.error:.1g}"
    printed = "" if reference.printed is None else f"{reference.printed:.10g}"
    cells = (
        name,
        f"{row.value:.10g}",
        error,
        f"{reference.value:.10g}",
        printed,
        row.distance,
        row.verdict,
    )
    return tuple(Text(cell) for cell in cells)  # as Text, [m] is a unit and not markup
