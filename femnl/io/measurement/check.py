"""A group as found, checked against the contract: SI units, named dimensions, sorted axes.

Every change is put into words.
"""

from collections.abc import Hashable, Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io.measurement.contract import (
    CONTROLS,
    KINDS,
    LEAST,
    MOST,
    MOST_DECIBELS,
    Contract,
    Item,
)
from femnl.io.measurement.control_variables import free_items, with_free
from femnl.io.measurement.head import text
from femnl.io.measurement.repair import mend
from femnl.io.measurement.shapes import fit_shapes
from femnl.io.measurement.units import quantity, to_si

_FIXED = ("kind", "convention")


def check(group: xr.Dataset, where: str, *, free: bool = True) -> tuple[xr.Dataset, list[str]]:
    """Bring one measurement into the form of the contract.

    Args: group: datasets with any names of dimensions; where: what messages name, such as "file:
    group"; free: whether its version of the contract lets it name control variables of its own.
    Returns: the Dataset in SI units with the contract's dimensions and coordinates, and a line for
    every change made.
    Raises: MeasurementError with the dataset, the value and the remedy, where no change is safe.
    """
    name = text(group.attrs.get("kind", ""))
    if name not in KINDS:
        raise MeasurementError(
            f"{where}: kind is {name!r}; give the group an attribute kind, one of "
            f"{', '.join(KINDS)}"
        )
    kind = KINDS[name]
    notes = []
    found = {str(key): variable for key, variable in group.variables.items()}
    if free:
        kind = with_free(kind, free_items(kind, found, where))
    why = _why_stray(kind, free=free)
    notes += [
        f"{where}/{stray}: not a dataset of kind {name}, left out{why}"
        for stray in sorted(found.keys() - kind.datasets.keys())
    ]
    arrays = {
        key: _values(found[key], kind.datasets[key], f"{where}/{key}", notes)
        for key in kind.datasets
        if key in found
    }
    attributes = _attributes(group.attrs, kind, arrays, where, notes)
    _demand(kind, name, arrays, where)
    shaped = fit_shapes(
        kind, arrays, {key: found[key].dims for key in arrays if key in found}, where, notes
    )
    data = {
        key: (kind.datasets[key].dims, values, _unit_attribute(kind.datasets[key]))
        for key, values in shaped.items()
    }
    labels = [key for key in kind.datasets if key in data and kind.datasets[key].coordinate]
    dataset = xr.Dataset(
        {key: data[key] for key in kind.datasets if key in data and key not in labels},
        coords={key: data[key] for key in labels},
        attrs={"kind": name, **attributes},
    )
    return mend(dataset, kind, where, notes), notes


def _why_stray(kind: Contract, *, free: bool) -> str:
    """Return what would make a stray dataset a control variable."""
    if not kind.free:
        return ""
    if not free:
        return "; a file of version 1.2 may name control variables of its own"
    return f"; a control variable is one number a {kind.free[0]} with its unit in attribute units"


def _unit_attribute(item: Item) -> dict[str, str]:
    return {"units": item.unit} if item.unit else {}


def _values(variable: xr.Variable, item: Item, where: str, notes: list[str]) -> NDArray[Any]:
    values = np.asarray(variable.values)
    if item.unit is None:
        return np.array([text(value) for value in values.reshape(-1)], dtype=object).reshape(
            values.shape
        )
    if values.dtype.kind not in "iuf":
        raise MeasurementError(
            f"{where}: holds {values.dtype}, not real numbers; store complex data as real and "
            "imag, the rest as float64"
        )
    unit = text(variable.attrs["units"]) if "units" in variable.attrs else None
    if unit is None and item.unit:
        notes.append(f"{where}: has no units attribute, taken as {item.unit}")
    numbers = to_si(values, item.unit if unit is None else unit, item.unit, where)
    if unit is not None and not np.array_equal(numbers, values, equal_nan=True):
        notes.append(f"{where}: converted from {unit} to {item.unit or '1'}")
    infinite = np.isinf(numbers)
    if infinite.any():
        notes.append(
            f"{where}: {np.count_nonzero(infinite)} infinite values taken as missing (NaN)"
        )
        numbers = np.where(infinite, np.nan, numbers)
    if item.positive and np.any(numbers <= 0):
        detuned = item.unit == "Hz" and np.any(numbers < 0)
        remedy = "add the frequency that detunings count from" if detuned else "mark missing points"
        raise MeasurementError(
            f"{where}: value {numbers[numbers <= 0].flat[0]:g} is not positive; {remedy}"
            f"{'' if detuned else ' by NaN'}"
        )
    return _of_a_size(numbers, item, where, notes)


def _of_a_size(
    numbers: NDArray[np.float64], item: Item, where: str, notes: list[str]
) -> NDArray[np.float64]:
    """Refuse values beyond any laboratory; those too small to be other than 0 become 0."""
    most = MOST_DECIBELS if item.unit == "dB" else MOST
    size = np.abs(numbers)
    tiny = (size > 0) & (size < LEAST)
    wrong = (size > most) | (tiny & item.positive)
    if wrong.any():
        raise MeasurementError(
            f"{where}: value {numbers[wrong].flat[0]:g} {item.unit} is beyond any measurement "
            f"({LEAST:g} to {most:g}); check its unit, or mark it as missing (NaN)"
        )
    if tiny.any():
        notes.append(f"{where}: {np.count_nonzero(tiny)} values below {LEAST:g} taken as 0")
        return np.where(tiny, 0.0, numbers)
    return numbers


def _attributes(
    attributes: Mapping[Hashable, Any],
    kind: Contract,
    arrays: dict[str, NDArray[Any]],
    where: str,
    notes: list[str],
) -> dict[str, str | float]:
    """Return attributes in SI.

    One value given as attribute where the contract has one per sweep or point is kept for all,
    and noted.
    """
    clean: dict[str, str | float] = {}
    for key, value in attributes.items():
        name = str(key)
        item = kind.attributes.get(name)
        if name == "kind":
            continue
        if (
            item is None
            and name in kind.datasets
            and name not in arrays
            and len(kind.datasets[name].dims) == 1
        ):
            one = kind.datasets[name]
            number, _ = quantity(_plain(value), one.unit or "", f"{where}/{name}")
            if one.positive and number <= 0:
                raise MeasurementError(
                    f"{where}: attribute {name} is {number:g}; give a positive number in {one.unit}"
                )
            arrays[name] = _of_a_size(np.array(number), one, f"{where}/{name}", notes)
            notes.append(
                f"{where}/{name}: one attribute, taken for every {kind.datasets[name].dims[0]}"
            )
        elif item is not None and item.unit is not None:
            number, converted = quantity(_plain(value), item.unit, f"{where}: attribute {name}")
            if converted:
                notes.append(
                    f"{where}: attribute {name} {text(value)!r} converted to {number:g} {item.unit}"
                )
            if not np.isfinite(number) or (item.positive and number <= 0):
                raise MeasurementError(
                    f"{where}: attribute {name} is {number:g}; give a "
                    f"{'positive ' * item.positive}number in {item.unit}, or leave it out"
                )
            sized = _of_a_size(np.array([number]), item, f"{where}: attribute {name}", notes)
            clean[name] = float(sized[0])
        elif item is not None or name in _FIXED or isinstance(_plain(value), str | int | float):
            plain = _plain(value)
            clean[name] = plain if isinstance(plain, int | float) and item is None else text(value)
        else:
            notes.append(f"{where}: attribute {name} is neither text nor a number, left out")
    wavelength = clean.get("wavelength")
    if isinstance(wavelength, float) and not 1e-7 < wavelength < 1e-4:
        raise MeasurementError(
            f"{where}: attribute wavelength is {wavelength:g} m; give it in m, or as a text with "
            "its unit such as '632.8 nm'"
        )
    return clean


def _plain(value: object) -> object:
    """Return the attribute as str, int or float where it holds one of them."""
    if isinstance(value, bytes) or (
        isinstance(value, np.ndarray) and value.size == 1 and value.dtype.kind in "SUO"
    ):
        return text(value)
    if isinstance(value, np.ndarray | np.generic) and value.size == 1 and value.dtype.kind in "iuf":
        return value.reshape(-1)[0].item() if isinstance(value, np.ndarray) else value.item()
    return value


def _demand(kind: Contract, name: str, arrays: Mapping[str, NDArray[Any]], where: str) -> None:
    for key, item in kind.datasets.items():
        if item.required and key not in arrays:
            has = ", ".join(arrays) or "none"
            raise MeasurementError(
                f"{where}: dataset {key} is missing; kind {name} needs {key} {item.dims} in "
                f"{item.unit or '1'} (found: {has})"
            )
    for choice in kind.needs:
        if not any(key in arrays for key in choice):
            raise MeasurementError(
                f"{where}: kind {name} needs one of the datasets {', '.join(choice)}; add one"
                f"{_other(choice)}"
            )


def _other(choice: tuple[str, ...]) -> str:
    """Return how a present file may name a control variable that is not in the list, or ""."""
    if choice[0] not in CONTROLS:
        return ""
    return ", or in a file of version 1.2 another with its unit in the attribute units"
