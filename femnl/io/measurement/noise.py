"""Noise of a measurement: what its file says, or a robust estimate from the data themselves."""

from math import comb

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.core.numbers import engineering
from femnl.core.robust import MAD
from femnl.io.measurement.control_variables import controls

_ORDER = 4
_QUANTILE = 0.25


def amplitude(dataset: xr.Dataset) -> xr.DataArray:
    """Return the complex amplitude V = real + i·imag of a `response` or `map`, in V.

    v(t) = Re(V e^{inωt}). Magnitudes alone stand as they are, with no phase.
    """
    if "magnitude" in dataset:
        volts = dataset["magnitude"] + 0j
        return volts.rename("amplitude").assign_attrs(units="V")
    return (dataset["real"] + 1j * dataset["imag"]).rename("amplitude").assign_attrs(units="V")


def noise_sd(dataset: xr.Dataset) -> tuple[float, str]:
    """Return the noise of the data: the attribute `noise_sd` where there is one, else estimated.

    Returns: standard deviation [V, or the data's unit for `series`] per value (per quadrature of
    amplitudes), and a sentence for a report.
    Raises: MeasurementError as `estimate_noise`.
    """
    if "noise_sd" in dataset.attrs:
        return float(
            dataset.attrs["noise_sd"]
        ), f"noise {engineering(float(dataset.attrs['noise_sd']), 'V')} as stored"
    sd = estimate_noise(dataset)
    size = engineering(sd, "" if dataset.attrs["kind"] == "series" else "V")
    return sd, f"noise {size}, estimated from the data: noise_sd is not in the file"


def estimate_noise(dataset: xr.Dataset) -> float:
    """Estimate the white noise of a measurement from its own scatter.

    response, series: divided differences of order 4 over neighbouring points, scaled to unit
    variance, their median absolute deviation × 1.4826; map: the same along x and y at once; trace:
    the lower quartile of a Hann-windowed periodogram, which for white noise is −ln(3/4) of its
    mean.
    Args: dataset of kind response, map, trace or series. Returns: the standard deviation per value
    (per quadrature).
    Raises: MeasurementError for a `spectrum`, whose frequency_sd is required, for fewer than 8
    usable points, and for data without any scatter.
    Valid: signal smooth over five points (response, map, series), or lines and bands filling less
    than 3/4 of the spectrum (trace); otherwise the estimate is high.
    Source: generalised from J. Immerkær, Computer Vision and Image Understanding 64, 300 (1996), to
    order 4 and median.
    """
    kind = dataset.attrs["kind"]
    if kind == "response":
        names = ["magnitude"] if "magnitude" in dataset else ["real", "imag"]
        sweeps = zip(
            dataset.frequency.values, *(dataset[name].values for name in names), strict=True
        )
        residues = np.concatenate(
            [_divided_differences(f, part) for f, *parts in sweeps for part in parts]
        )
    elif kind == "map":
        residues = np.concatenate(
            [_mixed(part).ravel() for part in (dataset["real"].values, dataset["imag"].values)]
        )
    elif kind == "trace":
        return _floor(dataset.voltage.values)
    elif kind == "series":
        key = "frequency" if "frequency" in dataset else "quality_factor"
        control = dataset[next(iter(controls(dataset)))].values
        residues = _divided_differences(control, dataset[key].values)
    else:
        raise MeasurementError(
            f"{kind}: noise cannot be estimated from a list of modes; store frequency_sd"
        )
    return _spread(residues, kind)


def _spread(residues: NDArray[np.float64], kind: str) -> float:
    residues = residues[np.isfinite(residues)]
    if residues.size < 8:
        raise MeasurementError(
            f"{kind}: {residues.size} usable points are too few to estimate the noise; store "
            "noise_sd"
        )
    spread = float(MAD * np.median(np.abs(residues)))
    if spread > 0:
        return spread
    steps = np.abs(residues[residues != 0])
    if not steps.size:
        raise MeasurementError(
            f"{kind}: the data show no noise at all; they are constant or computed, store noise_sd"
        )
    # Most neighbours are equal, so that the last digit q of the instrument is what scatters: even
    # within ±q/2, and seen by a single residue as q over the norm of its weights
    return float(np.min(steps) * np.sqrt(comb(2 * _ORDER, _ORDER)) / np.sqrt(12))


def _divided_differences(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return divided differences of y(x), scaled so that white noise keeps its variance."""
    good = np.isfinite(x) & np.isfinite(y)
    x, first = np.unique(x[good], return_index=True)
    if x.size <= _ORDER:
        return np.empty(0)
    nodes = np.lib.stride_tricks.sliding_window_view(x, _ORDER + 1)
    values = np.lib.stride_tricks.sliding_window_view(y[good][first], _ORDER + 1)
    scaled = (nodes - nodes[:, :1]) / (nodes[:, -1:] - nodes[:, :1])
    gaps = scaled[:, :, None] - scaled[:, None, :] + np.eye(_ORDER + 1)
    weights = 1 / np.prod(gaps, axis=2)
    return np.asarray(np.sum(weights * values, axis=1) / np.linalg.norm(weights, axis=1))


def _mixed(image: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return differences along both axes of each (y, x) image.

    Even a signal that is steep in one direction is removed.
    """
    along, across = (min(_ORDER, size - 1) for size in image.shape[1:])
    differences = np.diff(np.diff(image, along, axis=1), across, axis=2)
    return np.asarray(differences / (_norm(along) * _norm(across)))


def _norm(order: int) -> float:
    """Return the root of the sum of squares of the weights of a difference of some order."""
    return float(np.sqrt(comb(2 * order, order)))


def _floor(voltage: NDArray[np.float64]) -> float:
    """Return the white-noise floor of each step's periodogram, the median over steps."""
    window = np.hanning(voltage.shape[1] + 1)[:-1]
    usable = [row for row in voltage if np.isfinite(row).all()]
    if not usable or voltage.shape[1] < 32:
        raise MeasurementError(
            "trace: no step has 32 samples without a gap, too few to estimate the noise; store "
            "noise_sd"
        )
    power = np.abs(
        np.fft.rfft((usable - np.mean(usable, axis=1, keepdims=True)) * window)[:, 1:-1]
    ) ** 2 / np.sum(window**2)
    floor = np.median(np.quantile(power, _QUANTILE, axis=1))
    if not floor > 0:
        raise MeasurementError(
            "trace: the voltage shows no noise at all; it is constant or computed, store noise_sd"
        )
    return float(np.sqrt(floor / -np.log(1 - _QUANTILE)))
