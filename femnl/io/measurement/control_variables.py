"""Control variables: those that femnl knows, and those that a file names and gives a unit."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from femnl.core.errors import MeasurementError
from femnl.io.measurement.contract import CONTROLS, KINDS, Contract, Item
from femnl.io.measurement.units import coherent

if TYPE_CHECKING:
    import xarray as xr

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,39}")
_SPREAD = "_sd"


def controls(dataset: xr.Dataset) -> dict[str, str]:
    """Return the SI unit of each control variable of a `series`, those that vary first.

    The control variables of a `response` are those of its sweeps. Of the variables that vary, those
    that femnl knows come first; the unit of a plain number is "".
    """
    kind = KINDS[str(dataset.attrs["kind"])]
    known = [name for name in CONTROLS if name in dataset.coords]
    others = [str(name) for name in dataset.coords if name not in kind.datasets]
    found = [name for name in (*known, *others) if dataset[name].dims == kind.free]
    found.sort(key=lambda name: not varies(dataset, name))
    return {name: _stated(dataset, name) for name in found}


def varies(dataset: xr.Dataset, name: str) -> bool:
    """Whether a control variable takes more than one value."""
    values = np.asarray(dataset[name].values, float)
    values = values[np.isfinite(values)]
    return bool(values.size and np.ptp(values) > 0)


def _stated(dataset: xr.Dataset, name: str) -> str:
    if name in CONTROLS:
        return CONTROLS[name]
    unit = str(dataset[name].attrs["units"])
    return "" if unit == "1" else unit


def free_item(kind: Contract, name: str, unit: str, where: str) -> Item:
    """Return the item of a control variable that no contract lists.

    Args: kind: of the measurement; name; unit: as written; where: what messages name.
    Raises: MeasurementError for a name or a unit that nothing can be told by.
    """
    if not _NAME.fullmatch(name) or name.endswith(_SPREAD) or name in kind.dims:
        raise MeasurementError(
            f"{where}: {name[:40]!r} cannot name a control variable; use up to 40 letters a-z, "
            f"digits and _, such as gate_voltage, no {' or '.join(kind.dims)}, and nothing that "
            f"ends in {_SPREAD}"
        )
    # A plain number says so in the file; a dataset without unit is no control variable
    return Item(kind.free, coherent(unit, where) or "1", coordinate=True)


def with_free(kind: Contract, items: Mapping[str, Item]) -> Contract:
    """Return the contract with further control variables."""
    if not items:
        return kind
    needs = tuple((*choice, *items) if choice[0] in CONTROLS else choice for choice in kind.needs)
    return replace(kind, datasets={**kind.datasets, **items}, needs=needs)


def free_items(kind: Contract, variables: Mapping[str, xr.Variable], where: str) -> dict[str, Item]:
    """Return the items of all datasets that are free control variables.

    Those are one-dimensional, hold real numbers and carry the attribute `units`.
    Raises: MeasurementError for a name or a unit that nothing can be told by.
    """
    if not kind.free:
        return {}
    return {
        name: free_item(kind, name, _text(variable.attrs["units"]), f"{where}/{name[:40]}")
        for name, variable in variables.items()
        if name not in kind.datasets and _is_free(name, variable)
    }


def _is_free(name: str, variable: xr.Variable) -> bool:
    numbers = variable.dtype.kind in "iuf" and variable.ndim == 1
    return numbers and "units" in variable.attrs and not name.endswith(_SPREAD)


def _text(value: object) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
