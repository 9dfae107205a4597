"""Failures that users can mend.

Each names what is wrong, the value found, and which setting to change.
"""


class FemnlError(Exception):
    """The base of all failures that femnl foresees.

    The command line prints its one line and exits with status 2.
    """


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


def one_line(text: str) -> str:
    """Return text with everything unprintable escaped, line ends first of all."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
