"""Tables of columns (from text or MATLAB) put into the shape of a measurement."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from femnl.core.errors import MeasurementError
from femnl.io import measurement
from femnl.io.labfiles.base import (
    PARTS,
    RMS,
    SWEEP_VALUES,
    refuse_lengths,
    scalar_values,
)
from femnl.io.labfiles.levels import even_clock, is_level, refuse_times_that_go_back
from femnl.io.labfiles.matrices import unrolled
from femnl.io.labfiles.named_columns import COMPLEX, Columns, need_columns
from femnl.io.labfiles.responses import BESIDE, PER_SWEEP, response_of
from femnl.io.labfiles.spec import Spec
from femnl.io.measurement import KINDS, coherent

if TYPE_CHECKING:
    import xarray as xr

_OF_A_DECAY = {"frequency": "Hz", "bandwidth": "Hz", "pressure": "Pa", "temperature": "K"}


def to_dataset(spec: Spec, columns: Columns, where: str) -> tuple[xr.Dataset, list[str]]:
    """Put columns into the shape of the measurement that the spec names.

    Long tables of a `response` are cut into sweeps where a per-sweep column changes or the
    frequency turns back; matrices have a sweep a row or a column. Tables of a `map` are spread over
    their grid, of a `trace` cut into steps where the drive frequency changes.
    Returns: the Dataset and notes. Raises: MeasurementError.
    """
    columns = dict(columns) if spec.kind != "response" else _of_all_points(columns)
    refuse_lengths(columns, where)
    _refuse_unused(spec, columns, where)
    if spec.kind == "decay":
        return _decay(spec, columns, where), []
    order: list[str] = []
    if spec.kind == "response" and any(values.ndim > 1 for values in columns.values()):
        listed = any(isinstance(spec.column(name).column, list) for name in spec.columns)
        columns, order = unrolled(columns, where, side_by_side=listed)
    _complex(spec, columns, where)
    if any(values.ndim > 1 for values in columns.values()) or spec.kind in ("spectrum", "series"):
        return _direct(spec, columns, where), []
    if spec.kind == "response":
        dataset, notes = response_of(spec, columns, _own_units(spec), where)
        return dataset, [*order, *notes]
    if spec.kind == "map":
        return _map(spec, columns, where), []
    return _trace(spec, columns, where)


def _of_all_points(columns: Columns) -> Columns:
    """Repeat what a lone sweep has one value of for each of its points."""
    count = max((values.size for values in columns.values() if values.ndim == 1), default=1)
    return {
        name: np.repeat(values, count) if name in SWEEP_VALUES and values.size == 1 else values
        for name, values in columns.items()
    }


def _refuse_unused(spec: Spec, columns: Columns, where: str) -> None:
    """Refuse a column that is named and that a table of this kind has no use for."""
    used = {
        "response": ("frequency", "time", "duration", "sweep", *PARTS, *PER_SWEEP, *BESIDE),
        "map": ("x", "y", "harmonic", *PARTS),
        "trace": ("time", "voltage", "drive_voltage", "drive_frequency"),
        "decay": ("time", "power", *PARTS),
    }.get(str(spec.kind))
    if used is None:
        return
    own = _own_units(spec)
    if spec.kind != "response" and any(values.ndim > 1 for values in columns.values()):
        used = (*KINDS[str(spec.kind)].datasets, *PARTS)
        own = {}
    for name in columns:
        if name not in used and name not in own:
            raise MeasurementError(
                f"{where}: columns.{name}: a table of kind {spec.kind} has one value of it for "
                "all; give it in [values], or leave it out"
            )


def _complex(spec: Spec, columns: Columns, where: str) -> None:
    """Replace magnitude and phase, or a complex amplitude, by real and imag.

    Root mean square by amplitude; decibel are amplitudes already. Magnitudes alone stay.
    """
    if "phase" in columns and "magnitude" not in columns:
        raise MeasurementError(f"{where}: columns.phase is that of a magnitude; leave it out")
    if "magnitude" in columns and "phase" not in columns and spec.kind == "response":
        level = is_level(spec.column("magnitude").unit)
        columns["magnitude"] = columns["magnitude"] * (RMS if spec.rms and not level else 1.0)
        return
    if "amplitude" in columns:
        values = columns.pop("amplitude")
    elif "magnitude" in columns:
        need_columns(columns, ("phase",), where)
        values = columns.pop("magnitude") * np.exp(1j * columns.pop("phase"))
    elif "real" in columns and "imag" in columns:
        values = columns["real"] + 1j * columns["imag"]
    else:
        return
    level = "magnitude" in spec.columns and is_level(spec.column("magnitude").unit)
    values = values * (RMS if spec.rms and not level else 1.0)
    columns["real"] = values.real
    columns["imag"] = values.imag


def _direct(spec: Spec, columns: Columns, where: str) -> xr.Dataset:
    """Return arrays that already have their shape, or lists of modes and points.

    The contract's check does the rest.
    """
    if spec.kind == "spectrum":
        need_columns(columns, ("frequency", "frequency_sd"), where)
        label = [str(value) for value in columns.pop("label")] if "label" in columns else None
        frequency = columns.pop("frequency")
        rest: dict[str, Any] = columns
        return measurement.spectrum(frequency, rest.pop("frequency_sd"), label, **rest)
    if spec.kind == "series":
        data = {
            key: columns.pop(key)
            for key in tuple(columns)
            if key.startswith(("frequency", "quality_factor"))
        }
        return measurement.series(columns, **data, units=_own_units(spec))
    datasets = KINDS[str(spec.kind)].datasets
    import xarray as xr

    variables = {}
    for key, values in columns.items():
        flat = (
            values.squeeze()
            if values.ndim > len(datasets[key].dims) or 1 in values.shape
            else values
        )
        attributes = {"units": datasets[key].unit} if datasets[key].unit else {}
        variables[key] = xr.Variable(
            [f"{key}_{axis}" for axis in range(flat.ndim)], flat, attributes
        )
    return xr.Dataset(variables, attrs={"kind": spec.kind, **spec.values})


def _own_units(spec: Spec) -> dict[str, str]:
    """Return the SI units of those columns that are control variables of the file's own."""
    known = (*KINDS[str(spec.kind)].datasets, *COMPLEX, "sweep")
    return {
        name: coherent(spec.column(name).unit or "", name) or "1"
        for name in spec.columns
        if name not in known
    }


def _decay(spec: Spec, columns: Columns, where: str) -> xr.Dataset:
    """Put a time and a power, a magnitude or an amplitude together."""
    need_columns(columns, ("time",), where)
    refuse_times_that_go_back(
        columns["time"], [f"{where}: row {row + 1}" for row in range(len(columns["time"]))]
    )
    if "amplitude" in columns or "phase" in columns:
        _complex(spec, columns, where)
    scalars = scalar_values(spec, _OF_A_DECAY, where)
    attributes: dict[str, float | str | None] = {**scalars}
    attributes |= {key: str(spec.values[key]) for key in ("notes", "mode") if key in spec.values}
    return measurement.decay(**columns, attributes=attributes)


def _map(spec: Spec, columns: Columns, where: str) -> xr.Dataset:
    need_columns(columns, ("x", "y", "real", "imag"), where)
    harmonic = columns.get(
        "harmonic",
        np.full(
            columns["x"].shape, scalar_values(spec, {"harmonic": ""}, where).get("harmonic", 1.0)
        ),
    )
    axes, places = zip(
        *(
            np.unique(values, return_inverse=True)
            for values in (harmonic, columns["y"], columns["x"])
        ),
        strict=True,
    )
    shape = tuple(axis.size for axis in axes)
    if np.prod(shape, dtype=float) > 20 * harmonic.size:
        sizes = f"{shape[2]} values of x and {shape[1]} of y for {harmonic.size} points"
        raise MeasurementError(
            f"{where}: {sizes} do not make a grid; give columns.x and columns.y a step such as "
            'round = "1 um"'
        )
    volts = np.full(shape, np.nan * (1 + 1j))
    flat = np.ravel_multi_index(places, shape)
    if np.unique(flat).size < flat.size:
        row = int(np.setdiff1d(np.arange(flat.size), np.unique(flat, return_index=True)[1])[0])
        raise MeasurementError(
            f"{where}: row {row + 1} repeats the place x = {columns['x'][row]:g}, y = "
            f"{columns['y'][row]:g}; delete one"
        )
    volts.ravel()[flat] = columns["real"] + 1j * columns["imag"]
    scalars = scalar_values(
        spec, {"noise_sd": "V", "wavelength": "m", "drive": "V", "drive_frequency": "Hz"}, where
    )
    return measurement.harmonic_map(axes[2], axes[1], axes[0], volts, **scalars)


def _trace(spec: Spec, columns: Columns, where: str) -> tuple[xr.Dataset, list[str]]:
    need_columns(columns, ("voltage",), where)
    if "time" not in columns:
        raise MeasurementError(
            f"{where}: columns.time is missing; say which column holds it, or give time = "
            f'{{ rate = "1 MHz" }}'
        )
    steps = columns.get("drive_frequency")
    cuts = (
        [0, *(np.flatnonzero(steps[1:] != steps[:-1]) + 1).tolist(), steps.size]
        if steps is not None
        else [0, columns["time"].size]
    )
    lengths = np.diff(cuts)
    if np.any(lengths != lengths[0]):
        raise MeasurementError(
            f"{where}: steps of the drive have {lengths.min()} to {lengths.max()} samples; give "
            "each the same number"
        )
    time, told = even_clock(columns["time"][: lengths[0]], where)
    cut = {key: values.reshape(lengths.size, -1) for key, values in columns.items()}
    scalars = scalar_values(spec, {"noise_sd": "V", "wavelength": "m", "x": "m", "y": "m"}, where)
    one = scalar_values(spec, {"drive_frequency": "Hz"}, where).get("drive_frequency")
    frequency = one if steps is None else cut["drive_frequency"][:, 0]
    found = measurement.trace(
        time,
        cut["voltage"],
        drive_frequency=frequency,
        drive_voltage=cut.get("drive_voltage"),
        **scalars,
    )
    return found, told
