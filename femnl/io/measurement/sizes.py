"""Whether a command can do with the size of a measurement, said before its arrays are read."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import h5py

from femnl.core.errors import MeasurementError
from femnl.core.kinds import Cost, KindSpec, kind_of
from femnl.core.memory import need_memory
from femnl.io.measurement.contract import KINDS
from femnl.io.measurement.hdf5_safety import open_hdf5
from femnl.io.measurement.head import text, whole

if TYPE_CHECKING:
    import xarray as xr

Use = Literal["show", "fit", "diagnose"]
"""What is done with a file."""
WORDS: Mapping[Use, str] = {"show": "a figure", "fit": "a fit", "diagnose": "a diagnosis"}
OWN = 2**29
"""Bytes that a command takes beside the data: Python, its libraries, compiled kernels, modes."""
NUMBER = 8
"""Bytes of a number, which is a float64 once it is read."""


@dataclass(frozen=True)
class _Group:
    """A group of a file by what it declares: attributes, and numbers in each of its datasets."""

    attrs: Mapping[str, Any]
    numbers: Mapping[str, int]

    def __contains__(self, name: str) -> bool:
        """Whether it has a dataset."""
        return name in self.numbers


def need_room(path: Path, use: Use, workers: int = 1) -> None:
    """Refuse a measurement file that is too large for a use, by the sizes that it declares.

    Args: path: a measurement file. use: what is done with it. workers: processes that each hold it.
    Raises: MeasurementError for more data than the use can end with; ParameterError for more than
    the memory holds.
    """
    with open_hdf5(path) as file, whole(path):
        groups = {
            name: _Group({"kind": "", **_attributes(item)}, _numbers(item))
            for name, item in file.items()
            if isinstance(item, h5py.Group)
        }
    _need_room(groups, str(path), use, workers)


def need_room_for(tree: xr.DataTree, where: str, use: Use) -> None:
    """Refuse measurements that are too large for a use; where: what messages name."""
    groups: dict[str, _Group] = {}
    for name, node in tree.children.items():
        sizes = {str(key): variable.size for key, variable in node.variables.items()}
        attributes = {str(key): value for key, value in node.attrs.items()}
        groups[str(name)] = _Group(attributes, sizes)
    _need_room(groups, where, use, 1)


def _attributes(group: h5py.Group) -> dict[str, Any]:
    return {name: text(value) for name, value in group.attrs.items()}


def _numbers(group: h5py.Group) -> dict[str, int]:
    sets = {name: item for name, item in group.items() if isinstance(item, h5py.Dataset)}
    return {name: math.prod(item.shape) for name, item in sets.items()}


def _need_room(groups: Mapping[str, _Group], where: str, use: Use, workers: int) -> None:
    held: dict[str, int] = {}
    specs: dict[str, KindSpec] = {}
    for name, group in groups.items():
        if group.attrs["kind"] not in KINDS:
            continue  # which is told when the file is read
        known = KINDS[group.attrs["kind"]].datasets
        # Any other is left out, such as the scale of a dimension without labels
        numbers = [size for key, size in group.numbers.items() if key in known]
        specs[name] = kind_of(group)
        held[name] = NUMBER * sum(numbers)
        _need_few(specs[name], max(numbers, default=0), f"{where}: {name}", use)
    if held:
        _need_memory(held, specs, where, use, workers)


def _need_few(spec: KindSpec, count: int, where: str, use: Use) -> None:
    most = cost(spec, use).most
    if most is not None and count > most:
        raise MeasurementError(
            f"{where}: holds {count:,} {spec.size.data}, and {WORDS[use]} of a {spec.name} takes "
            f"at most {most:,}; {spec.size.remedy}"
        )


def _need_memory(
    held: Mapping[str, int], specs: Mapping[str, KindSpec], where: str, use: Use, workers: int
) -> None:
    """Refuse what does not fit: all groups as read, and what is made of them at one time."""
    each = {name: cost(specs[name], use).memory * size for name, size in held.items()}
    together = [use == "diagnose" or spec.size.together for spec in specs.values()]
    most = sum(each.values()) if any(together) else max(each.values()) + sum(held.values())
    largest = max(each, key=lambda name: each[name])
    size = specs[largest].size
    fewer = "lower --workers, or " if workers > 1 else ""
    need_memory(
        workers * (OWN + most),
        f"{where}: {largest}: {held[largest] // NUMBER:,} numbers in {WORDS[use]}",
        f"{fewer}{size.remedy}",
    )


def cost(spec: KindSpec, use: Use) -> Cost:
    """Return what a use of a kind takes."""
    return {"show": spec.size.show, "fit": spec.size.fit, "diagnose": spec.size.diagnose}[use]
