"""Failures that users can mend.

Each names what is wrong, the value found, and which setting to change.
"""

import logging
import re
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches

LONGEST = 1000
"""Characters of a line for people; of a longer text, begin and end are shown."""


class FemnlError(Exception):
    """The base of all failures that femnl foresees.

    The command line prints its one line and exits with status 2.
    """

    def __str__(self) -> str:
        """Return the message as one line, whatever text of a file it quotes."""
        return one_line(super().__str__())


class GeometryError(FemnlError):
    """A geometry file, or the device it describes, cannot be used.

    point: (x, y) [m] of the place that is wrong, where there is one.
    """

    def __init__(self, message: str, point: tuple[float, float] | None = None) -> None:
        super().__init__(message)
        self.point = point


class MeasurementError(FemnlError):
    """A measurement file or a lab file cannot be used."""


class ConvergenceError(FemnlError):
    """An iteration or a discretisation did not reach its tolerance."""


class MissingLibraryError(FemnlError):
    """A system library or an optional package that the request needs is not installed."""


class ParameterError(FemnlError):
    """An argument of a command or function is outside what it can mean."""


def suggest(word: str, known: Sequence[str]) -> str:
    """Return a hint at the known word that was meant, or the list of all."""
    close = get_close_matches(word, known, n=1)
    return f"did you mean {close[0]}?" if close else f"expected one of {', '.join(known)}"


def one_line(text: str) -> str:
    """Return text as a terminal may show it: unprintable signs escaped, and the middle cut out.

    Unprintable are line ends, escape sequences, overrides of direction, and bytes of no encoding.
    """
    short = _cut(text)
    if short.isprintable():
        return short
    return _cut("".join(c if c.isprintable() else ascii(c)[1:-1] for c in short))


def _cut(text: str) -> str:
    half = LONGEST // 2
    return text if len(text) <= LONGEST else f"{text[:half]} … {text[-half:]}"


class _OneLine(logging.Formatter):
    """Writes a warning as the line that a user is shown."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line of a record."""
        return one_line(super().format(record))


def warn_in_lines() -> None:
    """Let warnings of femnl go to standard error, each a line."""
    shown = logging.StreamHandler()
    shown.setLevel(logging.WARNING)
    shown.setFormatter(_OneLine("femnl: %(message)s"))
    logging.basicConfig(handlers=[shown], level=logging.WARNING)


def leave_out_warnings() -> None:
    """Leave out warnings of libraries that no user can mend.

    NumPy's of numbers that overflow, which what uses them refuses, and Matplotlib's of signs that
    its font lacks, which stand as boxes in a figure. An option -W of Python brings them back.
    """
    if not sys.warnoptions:
        warnings.simplefilter("ignore", RuntimeWarning)
        warnings.filterwarnings("ignore", "Glyph .* missing from font", UserWarning)


OF_NUMBERS = re.compile(r"finite|\bnans?\b", re.IGNORECASE)
"""Words of NumPy and SciPy in the errors that values raise, and no mistake in a program does."""


@contextmanager
def numbers_of(what: str) -> Iterator[None]:
    """Say of which data a computation broke down over numbers that no step of it foresees.

    Raises: ConvergenceError in the place of overflows, divisions by zero, and what linear algebra
    and optimisers say of numbers that are not finite. Any other error is a fault of femnl.
    """
    try:
        yield
    except (ArithmeticError, ValueError) as error:
        if not _is_of_numbers(error):
            raise
        raise ConvergenceError(
            f"{what}: the computation breaks down on these numbers ({error}); look at them with "
            "femnl show, and leave out what is constant or out of proportion"
        ) from error


def _is_of_numbers(error: Exception) -> bool:
    """Whether values raised an error; NumPy, which has LinAlgError, is not loaded to refuse."""
    if isinstance(error, ArithmeticError) or type(error).__name__ == "LinAlgError":
        return True
    return OF_NUMBERS.search(str(error)) is not None
