"""Dimensions of stored arrays.

By name where the file has names, else by the contract's order, with sizes deciding what fits.
"""

from collections.abc import Hashable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io.measurement.contract import Contract, Item

Array = NDArray[Any]


def fit_shapes(
    kind: Contract,
    arrays: Mapping[str, Array],
    names: Mapping[str, tuple[Hashable, ...]],
    where: str,
    notes: list[str],
) -> dict[str, Array]:
    """Turn every array so that its axes are the contract's dimensions.

    Args: arrays as stored; names: the dimensions the file gives them; where: for messages; notes:
    every turn is appended here.
    Returns: arrays whose axes follow `kind`. Raises: MeasurementError where sizes disagree.
    """
    sizes: dict[str, int] = {}
    shaped: dict[str, Array] = {}

    def turn(key: str) -> tuple[bool, int, int]:
        # One value for all comes last, when it is known for how many
        return arrays[key].ndim == 0, len(kind.datasets[key].dims), -arrays[key].ndim

    for key in sorted(arrays, key=turn):
        item = kind.datasets[key]
        line = f"{where}/{key}"
        values = _fit(arrays[key], names.get(key, ()), item, sizes, line, notes)
        if not _fits(values.shape, item.dims, sizes) or 0 in values.shape:
            needs = ", ".join(f"{dim} = {sizes.get(dim, 'any')}" for dim in item.dims)
            raise MeasurementError(
                f"{line}: shape {values.shape} does not fit dimensions ({needs}); all datasets "
                "of a group share them"
            )
        sizes.update(zip(item.dims, values.shape, strict=True))
        shaped[key] = values
    return shaped


def _fit(
    values: Array,
    names: tuple[Hashable, ...],
    item: Item,
    sizes: Mapping[str, int],
    line: str,
    notes: list[str],
) -> Array:
    dims = item.dims
    if set(names) == set(dims) and names != dims and len(names) == values.ndim:
        notes.append(
            f"{line}: stored as ({', '.join(map(str, names))}), turned to ({', '.join(dims)})"
        )
        return values.transpose([names.index(dim) for dim in dims])
    if values.ndim > len(dims):
        flat = values.squeeze()
        if flat.ndim < len(dims):
            flat = flat.reshape((1,) * (len(dims) - flat.ndim) + flat.shape)
        if flat.ndim == len(dims):
            notes.append(f"{line}: shape {values.shape} flattened to {flat.shape}")
        return flat
    if values.ndim < len(dims):
        missing = dims[: len(dims) - values.ndim]
        counts = tuple(sizes.get(dim, 1) for dim in missing)
        for_all = item.coordinate or (values.ndim == 0 and line.endswith("_sd"))
        if for_all or all(n == 1 for n in counts):
            if values.ndim:
                notes.append(
                    f"{line}: has no {' or '.join(missing)} dimension, taken for "
                    f"{'all ' if max(counts) > 1 else 'the one '}{missing[0]}"
                )
            return np.broadcast_to(values, counts + values.shape).copy()
    if (
        values.ndim > 1
        and not _fits(values.shape, dims, sizes)
        and _fits(values.shape[::-1], dims, sizes)
    ):
        notes.append(
            f"{line}: shape {values.shape} turned to {values.shape[::-1]}, in the order "
            f"({', '.join(dims)})"
        )
        return values.transpose()
    return values


def _fits(shape: tuple[int, ...], dims: tuple[str, ...], sizes: Mapping[str, int]) -> bool:
    return len(shape) == len(dims) and all(
        sizes.get(dim, n) == n for dim, n in zip(dims, shape, strict=True)
    )
