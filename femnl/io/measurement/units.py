"""Units at the boundary: what a file says is turned into SI, or refused by name."""

import re

import numpy as np
import pint
from numpy.typing import ArrayLike, NDArray

from femnl.core.errors import MeasurementError

_REGISTRY = pint.get_application_registry()
_UNIT = r"[A-Za-zµμΩ°%]+(?:(?:\^|\*\*)?-?\d)?"
# Text from strangers reaches pint's parser only as a plain product of units: no numbers, brackets
# or towers of powers.
_PRODUCT = re.compile(rf"\s*(?:1\s*/\s*)?{_UNIT}(?:\s*[*/·\s]\s*{_UNIT})*\s*")
_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?)\s*([^\d\s].*?)?\s*")
_DIMENSIONLESS = ("", "1", "dimensionless")


def to_si(values: ArrayLike, unit: str, si: str, where: str) -> NDArray[np.float64]:
    """Convert `values` from `unit` to the SI unit `si` ("" means dimensionless).

    Args: values (any shape) in `unit`; where: what the message names, such as "file: group:
    dataset".
    Returns: the values in `si`. Raises: MeasurementError for an unknown unit or one of another
    dimension.
    """
    numbers = np.asarray(values, dtype=float)
    unit = "" if unit in _DIMENSIONLESS else unit
    if unit == si:
        return numbers
    if len(unit) > 40 or (unit and not _PRODUCT.fullmatch(unit)):
        raise MeasurementError(
            f"{where}: unit {unit[:40]!r} is not understood; give a unit such as {si or '1'!r}"
        )
    try:
        return np.asarray(_REGISTRY.Quantity(numbers, unit).to(si).magnitude, dtype=float)
    except pint.DimensionalityError:
        raise MeasurementError(
            f"{where}: unit {unit!r} is not a unit of this quantity; give it in {si or '1'!r} or "
            "a multiple"
        ) from None
    except (
        pint.PintError,
        pint.errors.PintTypeError,
        AttributeError,
        ValueError,
        TypeError,
        AssertionError,
    ):
        raise MeasurementError(
            f"{where}: unit {unit!r} is unknown; give a unit such as {si or '1'!r}"
        ) from None


def quantity(value: object, si: str, where: str) -> tuple[float, bool]:
    """Read a scalar that is a number in SI or a text such as "632.8 nm".

    Returns: the number in `si`, and whether it had to be converted. Raises: MeasurementError if it
    is neither.
    """
    if isinstance(value, str):
        match = _QUANTITY.fullmatch(value) if len(value) < 80 else None
        if match is None:
            raise MeasurementError(
                f"{where}: {value[:40]!r} is not a quantity; give a number in {si or '1'!r}, or "
                f"a text such as '1.5 {si}'"
            )
        unit = match[2] or si
        return float(to_si(float(match[1]), unit, si, where)), unit != si
    number = np.asarray(value)
    if number.size != 1 or number.dtype.kind not in "iuf":
        raise MeasurementError(
            f"{where}: {str(value)[:40]!r} is not one number; give a number in {si or '1'!r}"
        )
    return float(number.reshape(())), False
