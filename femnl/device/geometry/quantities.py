"""Numbers with units, as geometry files write them: "270 um" becomes 270e-6, correctly rounded."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from decimal import Decimal
from functools import cache, partial
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator, Field
from pydantic_core import PydanticCustomError

if TYPE_CHECKING:
    from pint import UnitRegistry

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?"
_FACTOR = r"[A-Za-zµμΩÅ]+(?:(?:\^|\*\*)-?[1-9]|[²³])?"
# Only products and quotients of units: pint would also evaluate powers of powers, for hours.
_QUANTITY = re.compile(
    rf"\s*({_NUMBER})\s*({_FACTOR}(?:\s*[*/·]\s*{_FACTOR}|\s+{_FACTOR}){{0,9}})?\s*", re.ASCII
)


USUAL: dict[tuple[str, str], Decimal] = {
    ("m", "m"): Decimal(1),
    ("mm", "m"): Decimal("1e-3"),
    ("um", "m"): Decimal("1e-6"),
    ("µm", "m"): Decimal("1e-6"),
    ("nm", "m"): Decimal("1e-9"),
    ("Pa", "Pa"): Decimal(1),
    ("MPa", "Pa"): Decimal("1e6"),
    ("GPa", "Pa"): Decimal("1e9"),
    ("kg/m^3", "kg/m^3"): Decimal(1),
    ("deg", "rad"): Decimal("0.01745329251994329576923690768"),
}
"""Sizes of the units that most files are written in: loading pint takes as long as all else."""


@dataclass(frozen=True)
class Dimension:
    """A physical dimension.

    Its name, its SI unit, how to write one, and the magnitudes beyond any device.
    """

    name: str
    unit: str
    example: str
    smallest: float
    largest: float


LENGTH = Dimension("a length", "m", "270 um", 1e-12, 1e3)
PRESSURE = Dimension("a pressure", "Pa", "250 GPa", 1.0, 1e13)
DENSITY = Dimension("a density", "kg/m^3", "3100 kg/m^3", 1e-3, 1e6)
SPRING = Dimension("a force per length and displacement", "Pa", "20 GPa", 1.0, 1e18)
TORSION = Dimension("a moment per length and angle", "N", "0.2 mN", 1e-15, 1e12)
ANGLE = Dimension("an angle", "rad", "30 deg", 1e-12, 2 * math.pi)
SLOPE = Dimension("a change of thickness by length", "m/m", "0.1 nm/um", 1e-12, 0.1)


def to_si(value: Any, dimension: Dimension, sign: str = "positive") -> float:
    """Return a written quantity in SI units.

    Args:
        value: text such as "270 um": one number and one unit.
        dimension: what it must measure.
        sign: `positive`, `not negative` or `any`.

    Returns:
        The double nearest to the value written.

    Raises:
        PydanticCustomError: what was expected instead, as one sentence.
    """
    wanted = f'expected {dimension.name}, write e.g. "{dimension.example}"'
    if isinstance(value, bool | int | float):
        raise refusal(
            f'expected {dimension.name} with its unit, in quotes, write e.g. "{dimension.example}"'
        )
    match = _QUANTITY.fullmatch(value) if isinstance(value, str) and len(value) < 80 else None
    if match is None:
        raise refusal(wanted)
    if match[2] is None:
        raise refusal(f"{wanted} (the unit is missing)")
    factor = _factor(match[2], dimension.unit)
    if factor is None:
        raise refusal(f'{wanted} (the unit "{match[2]}" is unknown)')
    if factor == 0:
        raise refusal(wanted)
    si = float(Decimal(match[1]) * factor)
    if sign != "any" and (si < 0 or (si == 0 and sign == "positive")):
        raise refusal(f"expected {dimension.name} that is {sign}")
    if abs(si) > dimension.largest or 0 < abs(si) < dimension.smallest:
        raise refusal(
            f"expected {dimension.name} from {dimension.smallest:g} to {dimension.largest:g} "
            f"{dimension.unit}, check the unit"
        )
    return si


def to_lengths(value: Any, sign: str = "positive") -> float | list[float]:
    """Return one written length, or a list of them, in metres.

    Raises:
        PydanticCustomError: what was expected instead, as one sentence.
    """
    if isinstance(value, list):
        return [to_si(entry, LENGTH, sign) for entry in value]
    return to_si(value, LENGTH, sign)


def refusal(reason: str, key: str | None = None) -> PydanticCustomError:
    """Return the error for a value, or for the value under `key` of a table."""
    return PydanticCustomError("geometry", "{reason}", {"reason": reason, "key": key})


@cache
def _registry() -> UnitRegistry[Decimal]:
    from pint import UnitRegistry

    return UnitRegistry(non_int_type=Decimal)


@cache
def _factor(unit: str, si: str) -> Decimal | None:
    """Return the size of a unit in the SI unit.

    0 if the dimensions differ, None if the unit is unknown.
    """
    if (unit, si) in USUAL:
        return USUAL[unit, si]
    from pint.errors import PintError

    registry = _registry()
    try:
        parsed = registry.parse_units(unit)
    except (PintError, KeyError, ValueError):
        return None
    if parsed.dimensionality != registry.parse_units(si).dimensionality:
        return Decimal(0)
    return Decimal(registry.Quantity(Decimal(1), parsed).to(si).magnitude)


Length = Annotated[float, BeforeValidator(partial(to_si, dimension=LENGTH))]
Depth = Annotated[float, BeforeValidator(partial(to_si, dimension=LENGTH, sign="not negative"))]
Coordinate = Annotated[float, BeforeValidator(partial(to_si, dimension=LENGTH, sign="any"))]
Lengths = Annotated[float | list[float], BeforeValidator(partial(to_lengths, sign="not negative"))]
Radii = Annotated[float | list[float], BeforeValidator(to_lengths)]
Angle = Annotated[float, BeforeValidator(partial(to_si, dimension=ANGLE, sign="any"))]
Pressure = Annotated[float, BeforeValidator(partial(to_si, dimension=PRESSURE))]
Stress = Annotated[float, BeforeValidator(partial(to_si, dimension=PRESSURE, sign="any"))]
Density = Annotated[float, BeforeValidator(partial(to_si, dimension=DENSITY))]
Spring = Annotated[float, BeforeValidator(partial(to_si, dimension=SPRING))]
LooseSpring = Annotated[
    float, BeforeValidator(partial(to_si, dimension=SPRING, sign="not negative"))
]
Torsion = Annotated[float, BeforeValidator(partial(to_si, dimension=TORSION, sign="not negative"))]
Slope = Annotated[float, BeforeValidator(partial(to_si, dimension=SLOPE, sign="any"))]
Position = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]
