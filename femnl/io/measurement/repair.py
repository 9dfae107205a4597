"""Values of a measurement put in order: missing rows, unsorted or repeated axes.

Nothing is changed without a line that says so.
"""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io.measurement.contract import Contract

_PAIRS = ("real", "imag")
_LAST = 1e300  # missing points stand behind all others


def mend(dataset: xr.Dataset, kind: Contract, where: str, notes: list[str]) -> xr.Dataset:
    """Sort axes, drop rows without a place and pair missing values.

    Args: dataset: shaped and in SI; where: for messages; notes: every change is appended here.
    Returns: the mended Dataset. Raises: MeasurementError where two different values claim one
    place, or nothing is left.
    """
    dataset = _whole_numbers(dataset, where)
    for axis in [key for key, item in kind.datasets.items() if item.axis]:
        dataset = _mend_axis(dataset, axis, where, notes)
    if dataset.attrs["kind"] == "response":
        dataset = _mend_sweeps(dataset, where, notes)
    if dataset.attrs["kind"] == "spectrum":
        good = np.isfinite(dataset.frequency.values) & np.isfinite(dataset.frequency_sd.values)
        dataset = _keep(
            dataset, "mode", good, f"{where}: modes without frequency or frequency_sd", notes
        )
    if dataset.attrs["kind"] == "series":
        controls = [np.isfinite(values.values) for values in dataset.coords.values()]
        data = [
            np.isfinite(dataset[key].values)
            for key in ("frequency", "quality_factor")
            if key in dataset
        ]
        good = np.logical_and.reduce(controls) & np.logical_or.reduce(data)
        dataset = _keep(
            dataset, "point", good, f"{where}: points without control variable or data", notes
        )
    return _pair_missing(dataset, where, notes)


def _whole_numbers(dataset: xr.Dataset, where: str) -> xr.Dataset:
    for key, allowed in (
        ("direction", "+1 (up) or −1 (down)"),
        ("harmonic", "a whole number from 1 up"),
    ):
        if key in dataset.coords:
            values = dataset[key].values
            good = (
                np.isin(values, (-1, 1))
                if key == "direction"
                else (values >= 1) & (values == np.round(values))
            )
            if not np.all(good):
                raise MeasurementError(
                    f"{where}/{key}: value {values[~good][0]:g} is not {allowed}; correct it"
                )
            dataset = dataset.assign_coords({key: dataset[key].astype(np.int64)})
    return dataset


def _keep(
    dataset: xr.Dataset, dim: str, good: NDArray[np.bool_], what: str, notes: list[str]
) -> xr.Dataset:
    if good.all():
        return dataset
    if not good.any():
        raise MeasurementError(
            f"{what}: all {good.size} are; nothing is left to use, store numbers instead of NaN"
        )
    rows = ", ".join(map(str, np.flatnonzero(~good)[:5])) + (
        ", …" if np.count_nonzero(~good) > 5 else ""
    )
    notes.append(f"{what} left out: {np.count_nonzero(~good)} of {good.size} (rows {rows})")
    return dataset.isel({dim: good})


def _mend_axis(dataset: xr.Dataset, axis: str, where: str, notes: list[str]) -> xr.Dataset:
    line = f"{where}/{axis}"
    dataset = _keep(
        dataset, axis, np.isfinite(dataset[axis].values), f"{line}: positions that are NaN", notes
    )
    values = dataset[axis].values
    if np.any(np.diff(values) < 0):
        notes.append(
            f"{line}: not in rising order ({values[0]:g} … {values[-1]:g}), sorted together with "
            "its data"
        )
        dataset = dataset.isel({axis: np.argsort(values, kind="stable")})
        values = dataset[axis].values
    repeated = np.flatnonzero(np.diff(values) == 0) + 1
    for index in repeated:
        first = dataset.isel({axis: index - 1})
        second = dataset.isel({axis: index})
        if not first.equals(second):
            raise MeasurementError(
                f"{line}: value {values[index]:g} is given twice with different data; correct or "
                "delete one of them"
            )
    if repeated.size:
        notes.append(
            f"{line}: {repeated.size} exact repeats (first at {values[repeated[0]]:g}) dropped"
        )
        dataset = dataset.isel({axis: np.setdiff1d(np.arange(values.size), repeated)})
    return dataset


def _mend_sweeps(dataset: xr.Dataset, where: str, notes: list[str]) -> xr.Dataset:
    if "harmonic" not in dataset.coords:
        notes.append(f"{where}/harmonic: not given, taken as 1")
        dataset = dataset.assign_coords(
            harmonic=("sweep", np.ones(dataset.sizes["sweep"], dtype=np.int64))
        )
    parts = ("magnitude",) if "magnitude" in dataset else _PAIRS
    if "magnitude" in dataset:
        _refuse_two_forms(dataset, where)
    table = np.stack([dataset.frequency.values, *(dataset[part].values for part in parts)])
    placeless = np.isnan(table[0]) & np.isfinite(table[1:]).any(axis=0)
    if placeless.any():
        notes.append(
            f"{where}/frequency: {np.count_nonzero(placeless)} points have data but no frequency, "
            "taken as missing"
        )
        table[:, placeless] = np.nan
    falling = np.any(np.diff(np.where(np.isnan(table[0]), _LAST, table[0]), axis=1) < 0, axis=1)
    if falling.any():
        count = f"{np.count_nonzero(falling)} of {falling.size}"
        notes.append(
            f"{where}/frequency: not in rising order in {count} sweeps, sorted together with "
            f"{' and '.join(parts)}"
        )
        order = np.argsort(table[0], axis=1, kind="stable")
        table = np.take_along_axis(table, order[None], axis=2)
    # Points measured twice at one frequency are data; the same number twice is a copy.
    copies = np.zeros(table.shape[1:], dtype=bool)
    copies[:, 1:] = np.all(np.diff(table, axis=2) == 0, axis=0)
    if copies.any():
        notes.append(
            f"{where}/frequency: {np.count_nonzero(copies)} exact repeats of points taken "
            "as missing"
        )
        table[:, copies] = np.nan
        table = np.take_along_axis(table, np.argsort(table[0], axis=1, kind="stable")[None], axis=2)
    dataset = dataset.assign(
        {part: dataset[part].copy(data=row) for part, row in zip(parts, table[1:], strict=True)}
    )
    dataset = dataset.assign_coords(frequency=dataset.frequency.copy(data=table[0]))
    used = np.isfinite(table).all(axis=0)
    dataset = _keep(
        dataset, "sweep", used.any(axis=1), f"{where}: sweeps without a single point", notes
    )
    return dataset.isel(point=np.isfinite(dataset.frequency.values).any(axis=0))


def _refuse_two_forms(dataset: xr.Dataset, where: str) -> None:
    """Refuse a response that has magnitudes beside real and imag, or magnitudes below 0."""
    if any(part in dataset for part in _PAIRS):
        raise MeasurementError(
            f"{where}: has magnitude beside real and imag; store one of the two forms"
        )
    size = dataset["magnitude"].values
    if np.any(size < 0):
        raise MeasurementError(
            f"{where}/magnitude: value {size[size < 0].flat[0]:g} V is negative; a magnitude in "
            "decibel has to name its unit, such as dBV or dBm"
        )


def _pair_missing(dataset: xr.Dataset, where: str, notes: list[str]) -> xr.Dataset:
    if all(part in dataset for part in _PAIRS):
        missing = np.isnan(dataset["real"].values) | np.isnan(dataset["imag"].values)
        halves = missing & ~(np.isnan(dataset["real"].values) & np.isnan(dataset["imag"].values))
        if halves.any():
            notes.append(
                f"{where}: {np.count_nonzero(halves)} points have only one of real and imag, "
                "taken as missing"
            )
            dataset = dataset.assign({part: dataset[part].where(~missing) for part in _PAIRS})
    for key in ("real", "voltage", "drive_voltage", "power", "magnitude"):
        if key in dataset:
            gone = np.isnan(dataset[key].values)
            if gone.all():
                raise MeasurementError(
                    f"{where}/{key}: all {gone.size} points are NaN; nothing is left to use"
                )
            if gone.any():
                notes.append(
                    f"{where}: {np.count_nonzero(gone)} of {gone.size} points are missing (NaN) "
                    "and are left out of fits"
                )
    return dataset
