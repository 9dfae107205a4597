"""Units at the boundary: what a file says is turned into SI, or refused by name."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from functools import cache
from typing import TYPE_CHECKING

from femnl.core.errors import MeasurementError

if TYPE_CHECKING:
    import numpy as np
    import pint
    from numpy.typing import ArrayLike, NDArray

_UNIT = r"[A-Za-zµμΩ°%]+(?:(?:\^|\*\*)?-?\d)?"
# Text from strangers reaches pint's parser only as a plain product of units: no numbers, brackets
# or towers of powers.
_PRODUCT = re.compile(rf"\s*(?:1\s*/\s*)?{_UNIT}(?:\s*[*/·\s]\s*{_UNIT})*\s*")
_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?)\s*([^\d\s].*?)?\s*")
LONGEST = 80
"""Letters of a quantity, and one more."""
_DIMENSIONLESS = ("", "1", "dimensionless")
_SPELT = {"Torr": "torr", "mTorr": "mtorr", "mBar": "mbar", "Bar": "bar"}
"""How instruments and people write units that pint knows by other names."""
_NAMED = ("V", "A", "T", "K", "m", "kg", "s", "N", "Pa", "J", "W", "C", "F", "ohm", "H", "Wb")


@cache
def _registry() -> pint.registry.ApplicationRegistry:
    """Return all units; to load them takes as long as all else of a refusal."""
    import pint

    registry: pint.registry.ApplicationRegistry = pint.get_application_registry()
    return registry


@cache
def _failures() -> tuple[type[Exception], ...]:
    """Return what pint raises for text that is no unit."""
    from pint import PintError
    from pint.errors import PintTypeError

    return (PintError, PintTypeError, AttributeError, ValueError, TypeError, AssertionError)


def to_si(values: ArrayLike, unit: str, si: str, where: str) -> NDArray[np.float64]:
    """Convert `values` from `unit` to the SI unit `si` ("" means dimensionless).

    A frequency in rad/s, deg/s or rpm is angular: f = ω/2π.

    Args: values (any shape) in `unit`; where: what the message names, such as "file: group:
    dataset".
    Returns: the values in `si`. Raises: MeasurementError for an unknown unit or one of another
    dimension.
    """
    import numpy as np

    numbers = np.asarray(values, dtype=float)
    unit = "" if unit in _DIMENSIONLESS else unit
    si = "" if si in _DIMENSIONLESS else si
    unit = _SPELT.get(unit, unit)
    if unit == si:
        return numbers
    if len(unit) > 40 or (unit and not _PRODUCT.fullmatch(unit)):
        raise MeasurementError(
            f"{where}: unit {unit[:40]!r} is not understood; give a unit such as {si or '1'!r}"
        )
    from pint import DimensionalityError

    try:
        found = np.asarray(_registry().Quantity(numbers, unit).to(si).magnitude, dtype=float)
        return found / (2 * np.pi) if si == "Hz" and _is_angular(unit) else found
    except DimensionalityError:
        raise MeasurementError(
            f"{where}: unit {unit!r} is not a unit of this quantity; give it in {si or '1'!r} or "
            "a multiple"
        ) from None
    except _failures():
        raise MeasurementError(
            f"{where}: unit {unit!r} is unknown; give a unit such as {si or '1'!r}"
        ) from None


def _is_angular(unit: str) -> bool:
    """Whether a unit is one of angles per time, which pint takes for plain numbers."""
    return "radian" in _registry().get_root_units(unit)[1]._units


def is_unit_of(unit: str, si: str) -> bool:
    """Whether text is a unit of what the SI unit `si` measures."""
    try:
        to_si(1.0, unit, si, "")
    except MeasurementError:
        return False
    return True


def multiples(si: str) -> tuple[str, ...]:
    """Return an SI unit with the prefixes that files use: mV for V."""
    return (si, *(prefix + si for prefix in "fpnuµmkMGT"))


def coherent(unit: str, where: str) -> str:
    """Return the SI unit of what `unit` measures, as near to it as can be: V for mV, K for degC.

    "" for a plain number. Raises: MeasurementError for text that is no unit, or none of the SI.
    """
    if unit in _DIMENSIONLESS:
        return ""
    wrong = MeasurementError(
        f"{where}: unit {unit[:40]!r} is unknown; give a unit such as 'V', 'mT' or 'kV/m', and "
        "'1' for a plain number"
    )
    if len(unit) > 40 or not _PRODUCT.fullmatch(unit):
        raise wrong
    try:
        found = next((name for name in _candidates(unit) if _is_coherent(name, unit)), None)
    except _failures():
        raise wrong from None
    if found is None:
        raise wrong
    return "" if found in _DIMENSIONLESS else found


def _candidates(unit: str) -> Iterator[str]:
    """Yield names of the SI unit: as written, without prefixes, its own, in base units."""
    yield unit
    factors = _registry().parse_units(unit)._units
    plain = [
        _registry().Unit(_registry().parse_unit_name(name)[0][1]) ** power
        for name, power in factors.items()
    ]
    yield _written(math.prod(plain[1:], start=plain[0]))
    yield from _NAMED
    yield _written(_registry().Quantity(1.0, unit).to_base_units().units)


def _written(unit: pint.Unit) -> str:
    return f"{unit:~C}".replace("**", "^")


def _is_coherent(name: str, unit: str) -> bool:
    """Whether a unit is one of the SI without any factor, of the dimension of `unit`."""
    if name not in _DIMENSIONLESS and not _PRODUCT.fullmatch(name):
        return False
    one = _registry().Quantity(1.0, "" if name in _DIMENSIONLESS else name)
    alike = one.dimensionality == _registry().Quantity(1.0, unit).dimensionality
    return bool(alike and one.to_base_units().magnitude == 1.0)


def is_quantity(words: str) -> bool:
    """Whether words are a number, with or without what may be its unit."""
    return len(words) < LONGEST and _QUANTITY.fullmatch(words) is not None


def quantity(value: object, si: str, where: str) -> tuple[float, bool]:
    """Read a scalar that is a number in SI or a text such as "632.8 nm".

    Returns: the number in `si`, and whether it had to be converted. Raises: MeasurementError if it
    is neither.
    """
    if isinstance(value, str):
        match = _QUANTITY.fullmatch(value) if len(value) < LONGEST else None
        if match is not None and (match[2] or "").startswith(","):
            raise MeasurementError(
                f"{where}: {value[:40]!r} has a decimal comma; write a point in its place"
            )
        if match is None:
            raise MeasurementError(
                f"{where}: {value[:40]!r} is not a quantity; give a number in {si or '1'!r}, or "
                f"a text such as '1.5 {si}'"
            )
        unit = match[2] or si
        return float(to_si(float(match[1]), unit, si, where)), unit != si
    import numpy as np

    number = np.asarray(value)
    if number.size != 1 or number.dtype.kind not in "iuf":
        raise MeasurementError(
            f"{where}: {str(value)[:40]!r} is not one number; give a number in {si or '1'!r}"
        )
    return float(number.reshape(())), False
