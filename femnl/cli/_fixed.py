"""`--fix NAME=VALUE` of `femnl fit`: values with or without their unit, in SI."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from femnl.core.errors import MeasurementError, ParameterError
from femnl.io.measurement.units import is_quantity, quantity

Texts = Mapping[str, str]
"""What --fix says, by the name of the parameter."""
Units = Callable[[str], str | None]
"""The unit of a parameter by its name, None for one that the fit does not have."""


def read(texts: list[str]) -> dict[str, str]:
    """Read NAME=VALUE of --fix. Raises: ParameterError for a text of another form."""
    found = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (equals and name.strip() and value.strip()):
            raise ParameterError(
                f"--fix {text}: expected NAME=VALUE in SI units or with its unit, such as "
                'linewidth=66.7 or linewidth="66.7 Hz"'
            )
        if not is_quantity(value):
            raise ParameterError(
                f"--fix {name.strip()}: {value.strip()[:40]!r} is not a quantity; give a number in "
                "SI units or with its unit, such as '66.7 Hz'"
            )
        found[name.strip()] = value.strip()
    return found


def in_si(texts: Texts, unit_of: Units) -> dict[str, float]:
    """Return the values in SI; a name that the fit does not have is left to it to refuse.

    Raises: ParameterError for a value that is no number with a unit of its parameter.
    """
    return {name: _value(name, text, unit_of) for name, text in texts.items()}


def _value(name: str, text: str, unit_of: Units) -> float:
    """Return one value; the place or the map that a name ends with seldom changes its unit."""
    unit = unit_of(name)
    if unit is None:
        unit = unit_of(name.partition("[")[0].partition(":")[0])
    if unit is None:
        # Never used: the fit knows no such name
        return 0.0
    try:
        return quantity(text, "" if unit == "1" else unit, f"--fix {name}")[0]
    except MeasurementError as error:
        raise ParameterError(str(error)) from None
