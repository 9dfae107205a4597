"""The model of a harmonic map, V_n(x, y) = V_C e^{inφ} Σ_k 2Re(c_k iⁿ e^{ikθ}) J_n(kqUξ), and its derivatives.

The fringe is scaled so that its first overtone is one cosine (c₁ = 1): V_C and θ then mean the same for a sine and for a stack.
ξ is taken at the point of the simulated membrane that lies under (x, y): shift back, turn back, shrink by the scale.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.interpolate import CubicHermiteSpline

from femnl.errors import MeasurementError, ParameterError
from femnl.measurement import noise_sd
from femnl.types.readout import Array, ComplexArray, FourierSeries, PeriodicFringe

Shape = Callable[[Array, Array], Array]
"""ξ at points (x, y) [m] from the centre of the simulated membrane; max|ξ| = 1, zero outside."""

UNITS = {
    "amplitude": "m",
    "contrast": "V",
    "fringe_phase": "rad",
    "motion_phase": "rad",
    "x": "m",
    "y": "m",
    "scale": "1",
    "rotation": "rad",
}
REGISTRATION = ("x", "y", "scale", "rotation")
OVERTONE = "overtone_{k}_{part}"
"""Names of the free parts of an overtone of the fringe, relative to its fundamental; part is `real` or `imag`."""
FAINT = 1e-7
"""Overtones of the fringe below this part of the first change no map that can be measured and are left out."""
NODES = 64
"""Nodes a radian of z at which the harmonics are tabulated: the interpolation errs by less than 1e-7 of V_C."""


@dataclass(frozen=True)
class MapData:
    """One measured map, flattened: points (n_points,), values and whether present (n_harmonics, n_points).

    nominal: θ of the fringe as it was given [rad], None where it was not.
    """

    name: str
    x: Array
    y: Array
    harmonic: np.ndarray[tuple[int], np.dtype[np.int64]]
    values: ComplexArray
    present: np.ndarray[tuple[int, int], np.dtype[np.bool_]]
    noise: float
    noise_known: bool
    note: str
    spacing: float
    series: FourierSeries
    nominal: float | None
    pixels: tuple[np.ndarray[tuple[int], np.dtype[np.intp]], tuple[int, int]]

    @property
    def wavenumber(self) -> float:
        """Phase of the fringe per displacement, q = 2π/Λ = 4π/λ, in rad/m."""
        return 2 * np.pi / self.series.period

    def image(self, values: ComplexArray) -> ComplexArray:
        """Return values (n_harmonics, n_points) laid out as (n_harmonics, n_y, n_x), NaN where nothing was measured."""
        index, shape = self.pixels
        full = np.full((len(self.harmonic), shape[0] * shape[1]), np.nan + 0j)
        full[:, index] = np.where(self.present, values, np.nan)
        return full.reshape(-1, *shape)


def flatten(name: str, dataset: xr.Dataset, fringe: PeriodicFringe | None) -> MapData:
    """Return the measured points of a `map`, with the fringe that will be fitted to it (one cosine of period λ/2 unless given)."""
    where = f"map {name!r}" if name else "map"
    harmonic = dataset["harmonic"].values.astype(np.int64)
    if harmonic.min() < 1:
        raise MeasurementError(f"{where}: harmonic {harmonic.min()} cannot be fitted, as its offset is not optical; leave it out")
    values = np.asarray(dataset["real"].values + 1j * dataset["imag"].values)
    present = np.isfinite(values).reshape(len(harmonic), -1)
    used = np.flatnonzero(present.any(axis=0))
    if used.size == 0:
        raise MeasurementError(f"{where}: no point has a value; at least one must not be NaN")
    x, y = dataset["x"].values.astype(float), dataset["y"].values.astype(float)
    across, up = np.meshgrid(x, y)
    noise, note = noise_sd(dataset)
    steps = [np.ptp(axis) / (axis.size - 1) for axis in (x, y) if axis.size > 1]
    return MapData(
        name=name,
        x=across.ravel()[used],
        y=up.ravel()[used],
        harmonic=harmonic,
        values=np.where(present, values.reshape(len(harmonic), -1), 0)[:, used],
        present=present[:, used],
        noise=noise,
        noise_known="noise_sd" in dataset.attrs,
        note=f"{where}: {note}",
        spacing=min(steps, default=1e-6),
        series=_unit_fringe(where, dataset, fringe),
        nominal=None if fringe is None else float(np.angle(fringe.fourier.coefficients[1])),
        pixels=(used, (y.size, x.size)),
    )


def _unit_fringe(where: str, dataset: xr.Dataset, fringe: PeriodicFringe | None) -> FourierSeries:
    """Return the fringe without offset, scaled and shifted to c₁ = 1, without its faintest overtones."""
    if fringe is None:
        if "wavelength" not in dataset.attrs:
            raise MeasurementError(f"{where}: without the attribute wavelength [m] no motion in metres can be found; add it to the file")
        return FourierSeries(float(dataset.attrs["wavelength"]) / 2, np.array([0, 1], complex))
    series = fringe.fourier
    first = series.coefficients[1] if len(series.coefficients) > 1 else 0.0
    if first == 0:
        raise ParameterError(f"{where}: the fringe does not change with displacement at its period {series.period:g} m; give one that does")
    k = np.arange(len(series.coefficients))
    unit = np.where(k == 0, 0, series.coefficients / abs(first) * np.exp(-1j * k * np.angle(first)))
    return FourierSeries(series.period, unit[: np.flatnonzero(abs(unit) > FAINT)[-1] + 1])


def overtone_weights(data: MapData, theta: Array) -> tuple[Array, Array]:
    """Return 2Re(c_k iⁿ e^{ikθ}) and its derivative by θ, shape (*theta.shape, n_harmonics, n_overtones)."""
    k = np.arange(1, len(data.series.coefficients))
    turned = data.series.coefficients[1:] * 1j ** data.harmonic[:, None] * np.exp(1j * k * theta[..., None, None])
    return 2 * turned.real, -2 * k * turned.imag


def locate(data: MapData, x: float, y: float, scale: float, rotation: float) -> tuple[Array, Array]:
    """Return the points of the simulated membrane [m] that lie under those of the map."""
    c, s = np.cos(rotation), np.sin(rotation)
    return (c * (data.x - x) + s * (data.y - y)) / scale, (c * (data.y - y) - s * (data.x - x)) / scale


def predict(data: MapData, shape: Shape, values: dict[str, float]) -> ComplexArray:
    """Return V_n at the map's points, (n_harmonics, n_points)."""
    xi = shape(*locate(data, *(values[name] for name in REGISTRATION)))
    motion = real_part(data, values["amplitude"] * xi, values)["motion"]
    return np.asarray(values["contrast"] * np.exp(1j * data.harmonic[:, None] * values["motion_phase"]) * motion)


def slopes(data: MapData, shape: Shape, values: dict[str, float]) -> dict[str, ComplexArray]:
    """Return the derivatives of V_n by every parameter, each (n_harmonics, n_points)."""
    across, up = locate(data, *(values[name] for name in REGISTRATION))
    c, s, scale = np.cos(values["rotation"]), np.sin(values["rotation"]), values["scale"]
    xi = shape(across, up)
    step = 1e-3 * data.spacing
    slope_x = (shape(across + step, up) - shape(across - step, up)) / (2 * step)
    slope_y = (shape(across, up + step) - shape(across, up - step)) / (2 * step)
    parts = real_part(data, values["amplitude"] * xi, values)
    turn = np.exp(1j * data.harmonic[:, None] * values["motion_phase"])
    motion, by_displacement = parts.pop("motion"), values["contrast"] * turn * parts.pop("by_displacement")
    by_xi = by_displacement * values["amplitude"]
    return {
        **{name: values["contrast"] * turn * part for name, part in parts.items()},
        "amplitude": by_displacement * xi,
        "contrast": turn * motion,
        "motion_phase": 1j * data.harmonic[:, None] * values["contrast"] * turn * motion,
        "x": by_xi * (s * slope_y - c * slope_x) / scale,
        "y": -by_xi * (s * slope_x + c * slope_y) / scale,
        "scale": -by_xi * (across * slope_x + up * slope_y) / scale,
        "rotation": by_xi * (up * slope_x - across * slope_y),
    }


def real_part(data: MapData, displacement: Array, values: dict[str, float]) -> dict[str, Array]:
    """Return g_n(a) = V_n e^{−inφ}/V_C as `motion`, and its derivatives by a [m], by θ and by the free overtones.

    g_n = (2/N) Σ_j f(qa cos ψ_j + θ) cos nψ_j at ψ_j = π(j + ½)/N, which is exact once 2N exceeds the content of v(t) (the sum
    over Bessel functions of `readout` is the same to rounding and far slower). All points share g_n(a), so it is computed with
    its slope at close nodes and interpolated to fourth order.
    """
    q, fringe, free = data.wavenumber, *_free_overtones(data, values)
    k = np.arange(len(fringe))
    n_nodes = 64 + int(NODES * q * np.ptp(displacement))
    few = n_nodes >= displacement.size or q * np.ptp(displacement) < 1e-6
    nodes = displacement if few else np.linspace(displacement.min(), displacement.max(), n_nodes)
    n_samples = 16 + int(data.harmonic.max() + k[-1] * q * np.abs(nodes).max()) // 2
    psi = np.pi * (np.arange(n_samples) + 0.5) / n_samples
    turn = np.exp(1j * (q * nodes[:, None] * np.cos(psi) + values["fringe_phase"]))
    project = 2 / n_samples * np.cos(psi[:, None] * data.harmonic)
    along = q * np.cos(psi[:, None]) * project
    f, by_phase, twice = (np.polynomial.polynomial.polyval(turn, (1j * k) ** m * fringe).real for m in range(3))
    samples = {"motion": (f, by_phase), "fringe_phase": (by_phase, twice)}
    samples |= {name: ((unit * turn**j).real, (1j * j * unit * turn**j).real) for name, (j, unit) in free.items()}
    value = np.stack([sample @ project for sample, _ in samples.values()], axis=-1)
    slope = np.stack([sample @ along for _, sample in samples.values()], axis=-1)
    if not few:
        spline = CubicHermiteSpline(nodes, value, slope)
        value, slope = spline(displacement), spline(displacement, 1)
    return dict(zip(samples, value.T, strict=True)) | {"by_displacement": slope.T[0]}


def _free_overtones(data: MapData, values: dict[str, float]) -> tuple[ComplexArray, dict[str, tuple[int, complex]]]:
    """Return the coefficients of the fringe with what the parameters add to its overtones, and order and unit of each such parameter."""
    free = {name: (int(name.split("_")[1]), 1j if name.endswith("imag") else 1 + 0j) for name in values if name.startswith("overtone_")}
    fringe = np.zeros(max([len(data.series.coefficients), *(k + 1 for k, _ in free.values())]), complex)
    fringe[: len(data.series.coefficients)] = data.series.coefficients
    for name, (k, unit) in free.items():
        fringe[k] += unit * values[name]
    return fringe, free
