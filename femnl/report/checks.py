"""The validation cases on the page.

What was checked, how many numbers agree, what is an erratum of the paper.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from femnl import validation
from femnl.report.mechanics import Say
from femnl.validation import Result


@dataclass(frozen=True)
class Checks:
    """Results of all cases: those of the paper's errata apart, and the counts for the summary."""

    results: tuple[Result, ...]

    @property
    def errata(self) -> list[Result]:
        """Cases that correct a printed number."""
        return [
            result
            for result in self.results
            if any(row.reference.printed is not None for row in result.rows)
        ]

    @property
    def numbers(self) -> int:
        """How many numbers were compared."""
        return sum(len(result.rows) for result in self.results)

    @property
    def agreeing(self) -> int:
        """How many of them agree with their reference."""
        return sum(row.verdict == "agrees" for result in self.results for row in result.rows)

    @property
    def failed(self) -> list[Result]:
        """Cases with a number that does not agree, or that broke off."""
        return [result for result in self.results if not result.passed]


def check(folder: Path, select: Sequence[str], say: Say) -> Checks:
    """Run the cases of a folder, all of them where none is selected."""
    results = []
    names = [path.stem for path in validation.find(folder, select)]
    say(f"validation: {names[0]}" if names else "validation: no cases")
    for k, result in enumerate(validation.run(folder, select), start=1):
        results.append(result)
        if k < len(names):
            say(f"validation: {names[k]}")
    return Checks(tuple(results))
