"""Builders: arrays in SI units to the Dataset of each kind of measurement."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from femnl.core.errors import MeasurementError
from femnl.io.measurement.contract import CONTROLS, KINDS, Item
from femnl.io.measurement.control_variables import free_item
from femnl.io.measurement.units import to_si


def _build(
    kind: str,
    arrays: Mapping[str, ArrayLike | None],
    attributes: Mapping[str, float | str | None] | None = None,
    free: Mapping[str, Item] | None = None,
) -> xr.Dataset:
    """Dataset of `kind` with the contract's dimensions and units.

    free: items of control variables that the contract does not list. Values are checked when it
    is bundled or written.
    """
    spec = {**KINDS[kind].datasets, **(free or {})}
    variables: dict[str, xr.Variable] = {}
    sizes: dict[str, int] = {}
    for key, given in arrays.items():
        if given is None:
            continue
        item = spec[key]
        values = np.asarray(given)
        expected = tuple(sizes.get(dim, n) for dim, n in zip(item.dims, values.shape, strict=False))
        if values.ndim != len(item.dims) or values.shape != expected:
            needs = ", ".join(f"{dim} = {sizes.get(dim, 'any')}" for dim in item.dims)
            raise MeasurementError(
                f"{kind}: {key} has shape {values.shape}, but needs ({needs}); all arrays of a "
                "measurement share them"
            )
        sizes.update(zip(item.dims, values.shape, strict=True))
        variables[key] = xr.Variable(item.dims, values, {"units": item.unit} if item.unit else {})
    return xr.Dataset(
        {key: value for key, value in variables.items() if not spec[key].coordinate},
        {key: value for key, value in variables.items() if spec[key].coordinate},
        {
            "kind": kind,
            **{key: value for key, value in (attributes or {}).items() if value is not None},
        },
    )


def spectrum(
    frequency: ArrayLike,
    frequency_sd: ArrayLike,
    label: Sequence[str] | None = None,
    time: ArrayLike | None = None,
    quality_factor: ArrayLike | None = None,
    quality_factor_sd: ArrayLike | None = None,
) -> xr.Dataset:
    """Eigenfrequencies of modes, all arrays of shape (mode,).

    Args: frequency, frequency_sd [Hz]; label "m,n" of each mode; time [s] of acquisition;
    quality_factor and its sd.
    Returns: Dataset of kind `spectrum`.
    """
    names = None if label is None else np.asarray(label, dtype=object)
    arrays = {"frequency": frequency, "frequency_sd": frequency_sd, "label": names, "time": time}
    return _build(
        "spectrum",
        {**arrays, "quality_factor": quality_factor, "quality_factor_sd": quality_factor_sd},
    )


def response(
    frequency: ArrayLike,
    amplitude: ArrayLike,
    *,
    drive: ArrayLike | None = None,
    direction: ArrayLike | None = None,
    x: ArrayLike | None = None,
    y: ArrayLike | None = None,
    harmonic: ArrayLike = 1,
    time: ArrayLike | None = None,
    duration: ArrayLike | None = None,
    temperature: ArrayLike | None = None,
    pressure: ArrayLike | None = None,
    laser_power: ArrayLike | None = None,
    voltage: ArrayLike | None = None,
    control: Mapping[str, ArrayLike] | None = None,
    units: Mapping[str, str] | None = None,
    noise_sd: float | None = None,
    wavelength: float | None = None,
    mode: str | None = None,
) -> xr.Dataset:
    """Driven response: v(t) = Re(V e^{inωt}) against drive frequency.

    Sweep by sweep, in the order taken.

    Args: frequency [Hz] and complex amplitude V [V], (sweep, point), frequency also (point,) for
    all sweeps; per sweep, or one number for all: drive [V], direction (+1 up, −1 down), x, y [m],
    harmonic, time at which it begins [s], duration [s], temperature [K], pressure [Pa],
    laser_power [W], voltage [V]; control: further control variables by name, one number a sweep
    or one for all; units: the unit of each of those, "1" for a plain number; noise_sd [V] per
    quadrature; wavelength [m]. See `magnitudes_alone` for data without phases.
    Returns: Dataset of kind `response`. Raises: MeasurementError for a name or a unit that is none.
    """
    volts = np.atleast_2d(np.asarray(amplitude))
    points = np.asarray(frequency, dtype=float)
    sweeps = volts.shape[0]
    labels = {
        "drive": drive,
        "direction": direction,
        "x": x,
        "y": y,
        "harmonic": harmonic,
        "time": time,
        "duration": duration,
        "temperature": temperature,
        "pressure": pressure,
        "laser_power": laser_power,
        "voltage": voltage,
    }
    others, free = _controls("response", control or {}, units or {})
    labels |= others
    per_sweep = {
        key: None if value is None else np.broadcast_to(np.asarray(value), (sweeps,))
        for key, value in labels.items()
    }
    if points.ndim == 1:
        points = np.broadcast_to(points, (sweeps, points.size))
    arrays = {"frequency": points, "real": volts.real, "imag": volts.imag, **per_sweep}
    return _build(
        "response", arrays, {"noise_sd": noise_sd, "wavelength": wavelength, "mode": mode}, free
    )


def magnitudes_alone(dataset: xr.Dataset) -> xr.Dataset:
    """Return a `response` that holds magnitudes |V| [V] in place of real and imag."""
    size = np.hypot(dataset["real"].values, dataset["imag"].values)
    held = xr.Variable(dataset["real"].dims, size, {"units": "V"})
    return dataset.drop_vars(["real", "imag"]).assign(magnitude=held)


def harmonic_map(
    x: ArrayLike,
    y: ArrayLike,
    harmonic: ArrayLike,
    amplitude: ArrayLike,
    *,
    noise_sd: float | None = None,
    wavelength: float | None = None,
    drive: float | None = None,
    drive_frequency: float | None = None,
    time: ArrayLike | None = None,
) -> xr.Dataset:
    """Maps of the amplitude of each harmonic: v(t) = Σ_n Re(V_n(x,y) e^{inωt}).

    Args: x, y [m] from the centre of the membrane; harmonic numbers n; complex amplitude V_n [V]
    (harmonic, y, x); noise_sd [V] per quadrature; wavelength [m]; drive [V]; drive_frequency [Hz];
    time [s] at which each point was measured (y, x).
    Returns: Dataset of kind `map`.
    """
    volts = np.asarray(amplitude)
    arrays = {
        "real": volts.real,
        "imag": volts.imag,
        "x": x,
        "y": y,
        "harmonic": harmonic,
        "time": time,
    }
    return _build(
        "map",
        arrays,
        {
            "noise_sd": noise_sd,
            "wavelength": wavelength,
            "drive": drive,
            "drive_frequency": drive_frequency,
        },
    )


def trace(
    time: ArrayLike,
    voltage: ArrayLike,
    *,
    drive_frequency: ArrayLike | None = None,
    drive_voltage: ArrayLike | None = None,
    noise_sd: float | None = None,
    wavelength: float | None = None,
    x: float | None = None,
    y: float | None = None,
) -> xr.Dataset:
    """Sampled signals, one a step of the drive.

    Args: time [s] (time,); voltage [V] (step, time); drive_frequency [Hz] (step,); drive_voltage
    [V] (step, time), the measured drive, where there is one; noise_sd [V] per sample; wavelength
    [m]; x, y [m] of the spot.
    Returns: Dataset of kind `trace`.
    """
    driven = None if drive_voltage is None else np.atleast_2d(np.asarray(drive_voltage))
    steps = None if drive_frequency is None else np.atleast_1d(np.asarray(drive_frequency))
    arrays = {
        "voltage": np.atleast_2d(np.asarray(voltage)),
        "time": time,
        "drive_frequency": steps,
        "drive_voltage": driven,
    }
    return _build("trace", arrays, {"noise_sd": noise_sd, "wavelength": wavelength, "x": x, "y": y})


def decay(
    time: ArrayLike,
    power: ArrayLike | None = None,
    magnitude: ArrayLike | None = None,
    real: ArrayLike | None = None,
    imag: ArrayLike | None = None,
    attributes: Mapping[str, float | str | None] | None = None,
) -> xr.Dataset:
    """One mode, or a close pair, that rings down.

    Whatever is before and after the decay may be left in.

    Args: time [s] (time,), and of the same shape one of power [dB], up to a constant, magnitude [V]
    or the complex amplitude real, imag [V]; attributes: frequency [Hz] of the mode, bandwidth [Hz]
    of the analyser, pressure [Pa], temperature [K], and texts such as notes, sample, mode.
    Returns: Dataset of kind `decay`.
    """
    arrays = {"time": time, "power": power, "magnitude": magnitude, "real": real, "imag": imag}
    return _build("decay", arrays, attributes)


def series(
    control: Mapping[str, ArrayLike],
    frequency: ArrayLike | None = None,
    frequency_sd: ArrayLike | None = None,
    quality_factor: ArrayLike | None = None,
    quality_factor_sd: ArrayLike | None = None,
    units: Mapping[str, str] | None = None,
) -> xr.Dataset:
    """Frequency and quality factor against control variables.

    All arrays have shape (point,), in the order taken.

    Args: control: by name pressure [Pa], temperature [K], laser_power [W], voltage [V], drive [V],
    time [s], and any other; frequency [Hz], quality_factor and their sd; units: the unit of each
    other control variable, such as {"gate_voltage": "mV"}, "1" for a plain number.
    Returns: Dataset of kind `series`. Raises: MeasurementError for a name or a unit that is none.
    """
    values, free = _controls("series", control, units or {})
    data = {
        "frequency": frequency,
        "frequency_sd": frequency_sd,
        "quality_factor": quality_factor,
        "quality_factor_sd": quality_factor_sd,
    }
    return _build("series", {**values, **data}, free=free)


def _controls(
    kind: str, control: Mapping[str, ArrayLike], units: Mapping[str, str]
) -> tuple[dict[str, ArrayLike], dict[str, Item]]:
    """Return the values of control variables in SI, and the items of those that are free."""
    values: dict[str, ArrayLike] = {}
    free = {}
    for name in units:
        if name not in control:
            raise MeasurementError(
                f"{kind}: units has {name!r}, which is no control variable of it; give one of "
                f"{', '.join(control) or 'none'}"
            )
    for name, given in control.items():
        known = KINDS[kind].datasets.get(name)
        if known is None and name not in units:
            raise MeasurementError(
                f"{kind}: control variable {name!r} needs its unit; give units = "
                f'{{{name!r}: "V"}}, "1" for a plain number, or use one of {", ".join(CONTROLS)}'
            )
        if known is not None and name not in CONTROLS:
            raise MeasurementError(
                f"{kind}: {name!r} is no control variable but a dataset of its own; name another"
            )
        where = f"{kind}: control variable {name}"
        item = known or free_item(KINDS[kind], name, units[name], where)
        if known is None:
            free[name] = item
        values[name] = to_si(given, units[name], item.unit or "", where) if name in units else given
    return values, free
