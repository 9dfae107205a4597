"""What a measurement file holds, in words that fit a terminal."""

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from femnl.core.errors import MeasurementError
from femnl.io.measurement import KINDS, amplitude, noise_sd
from femnl.plot.style import prefixed

_FEW = 40


def describe(tree: xr.DataTree) -> str:
    """Tell what is in a measurement file.

    Its attributes, then for each group size, ranges, noise and what was repaired.

    Args: tree: as from `femnl.io.measurement.read`. Returns: text of several lines.
    """
    lines = [
        f"{key}: {tree.attrs[key]}"
        for key in ("title", "geometry", "sample", "source")
        if key in tree.attrs
    ]
    for name, node in tree.children.items():
        lines += [f"{name}:", *(f"  {line}" for line in _group(node.to_dataset()))]
    lines += [f"repaired: {line}" for line in tree.attrs.get("repairs", ())]
    return "\n".join(lines)


def _group(dataset: xr.Dataset) -> list[str]:
    kind = str(dataset.attrs["kind"])
    contract = KINDS[kind]
    lines = [f"{kind}, " + " × ".join(f"{dim} {dataset.sizes[dim]}" for dim in contract.dims)]
    for key, item in contract.datasets.items():
        if key in ("real", "imag", "magnitude") or key not in dataset:
            continue
        values = dataset[key].values
        lines.append(
            f"{key.replace('_', ' ')}: "
            + (
                " ".join(f"({value})" for value in values)
                if item.unit is None
                else _range(values, item.unit)
            )
        )
    if "real" in dataset or "magnitude" in dataset:
        volts = np.abs(amplitude(dataset).values)
        lines.append(
            f"{'amplitude' if 'real' in dataset else 'magnitude'}: "
            f"up to {_number(np.nanmax(volts), 'V')}, "
            f"{np.count_nonzero(np.isfinite(volts))} of {volts.size} points present"
        )
    shown = {
        key: value
        for key, value in dataset.attrs.items()
        if key not in ("kind", "convention", "noise_sd")
    }
    units = {key: item.unit for key, item in contract.attributes.items()}
    lines += [
        f"{str(key).replace('_', ' ')}: {_attribute(value, units.get(str(key)))}"
        for key, value in shown.items()
    ]
    if kind in ("response", "map", "trace") and (
        "noise_sd" in dataset.attrs or next(iter(dataset.data_vars.values())).size > _FEW
    ):
        lines.append(_noise(dataset))
    return lines


def _noise(dataset: xr.Dataset) -> str:
    try:
        return noise_sd(dataset)[1]
    except MeasurementError as error:
        return f"noise unknown ({error})"


def _attribute(value: object, unit: str | None) -> str:
    return (
        _number(float(value), unit)
        if isinstance(value, int | float) and unit is not None
        else str(value)
    )


def _number(value: float, unit: str) -> str:
    divisor, name = prefixed(value, unit)
    return f"{value / divisor:.6g} {name}".strip()


def _range(values: ArrayLike, unit: str) -> str:
    """The values themselves where there are few, else smallest … largest."""
    numbers = np.asarray(values, dtype=float)
    divisor, name = prefixed(numbers, unit)
    distinct = np.unique(numbers[np.isfinite(numbers)]) / divisor
    words = (
        " … ".join(f"{value:.7g}" for value in (distinct[0], distinct[-1]))
        if distinct.size > 6
        else ", ".join(f"{value:.7g}" for value in distinct)
    )
    return f"{words} {name}".strip()
