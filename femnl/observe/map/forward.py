"""The model of a harmonic map and its derivatives.

V_n(x, y) = V_C e^{inφ} Σ_k 2Re(c_k iⁿ e^{ikθ}) J_n(kqUξ).

The fringe is scaled so that its first overtone is one cosine (c₁ = 1): V_C and θ then mean the same
for a sine and for a stack. ξ is taken at the point of the simulated membrane that lies under (x,
y): shift back, turn back, shrink by the scale.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import xarray as xr

from femnl.core.errors import MeasurementError
from femnl.core.readout import Array, ComplexArray, FourierSeries, PeriodicFringe
from femnl.io.measurement import noise_sd
from femnl.optics.unit_fringe import cosine, real_part, unit_fringe

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


@dataclass(frozen=True)
class MapData:
    """One measured map, flattened.

    points (n_points,), values and whether present (n_harmonics, n_points).

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
        """Return values (n_harmonics, n_points) as (n_harmonics, n_y, n_x), NaN in gaps."""
        index, shape = self.pixels
        full = np.full((len(self.harmonic), shape[0] * shape[1]), np.nan + 0j)
        full[:, index] = np.where(self.present, values, np.nan)
        return full.reshape(-1, *shape)


def flatten(name: str, dataset: xr.Dataset, fringe: PeriodicFringe | None) -> MapData:
    """Return the measured points of a `map`, with the fringe that will be fitted to it.

    One cosine of period λ/2 unless given.
    """
    where = f"map {name!r}" if name else "map"
    harmonic = dataset["harmonic"].values.astype(np.int64)
    if harmonic.min() < 1:
        raise MeasurementError(
            f"{where}: harmonic {harmonic.min()} cannot be fitted, as its offset is not optical; "
            "leave it out"
        )
    values = np.asarray(dataset["real"].values + 1j * dataset["imag"].values)
    present = np.isfinite(values).reshape(len(harmonic), -1)
    used = np.flatnonzero(present.any(axis=0))
    if used.size == 0:
        raise MeasurementError(f"{where}: no point has a value; at least one must not be NaN")
    x = dataset["x"].values.astype(float)
    y = dataset["y"].values.astype(float)
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
        series=_fringe_of(where, dataset, fringe),
        nominal=None if fringe is None else float(np.angle(fringe.fourier.coefficients[1])),
        pixels=(used, (y.size, x.size)),
    )


def _fringe_of(where: str, dataset: xr.Dataset, fringe: PeriodicFringe | None) -> FourierSeries:
    """Return the fringe to fit, scaled; one cosine of the map's wavelength where none is given."""
    if fringe is None and "wavelength" not in dataset.attrs:
        raise MeasurementError(
            f"{where}: without the attribute wavelength [m] no motion in metres can be found; "
            "add it to the file"
        )
    return (
        cosine(float(dataset.attrs["wavelength"]))
        if fringe is None
        else unit_fringe(fringe.fourier)
    )


def locate(data: MapData, x: float, y: float, scale: float, rotation: float) -> tuple[Array, Array]:
    """Return the points of the simulated membrane [m] that lie under those of the map."""
    c = np.cos(rotation)
    s = np.sin(rotation)
    return (c * (data.x - x) + s * (data.y - y)) / scale, (
        c * (data.y - y) - s * (data.x - x)
    ) / scale


def predict(data: MapData, shape: Shape, values: dict[str, float]) -> ComplexArray:
    """Return V_n at the map's points, (n_harmonics, n_points)."""
    xi = shape(*locate(data, *(values[name] for name in REGISTRATION)))
    motion = real_part(data.series, data.harmonic, values["amplitude"] * xi, values)["motion"]
    return np.asarray(
        values["contrast"] * np.exp(1j * data.harmonic[:, None] * values["motion_phase"]) * motion
    )


def slopes(data: MapData, shape: Shape, values: dict[str, float]) -> dict[str, ComplexArray]:
    """Return the derivatives of V_n by every parameter, each (n_harmonics, n_points)."""
    across, up = locate(data, *(values[name] for name in REGISTRATION))
    c = np.cos(values["rotation"])
    s = np.sin(values["rotation"])
    scale = values["scale"]
    xi = shape(across, up)
    step = 1e-3 * data.spacing
    slope_x = (shape(across + step, up) - shape(across - step, up)) / (2 * step)
    slope_y = (shape(across, up + step) - shape(across, up - step)) / (2 * step)
    parts = real_part(data.series, data.harmonic, values["amplitude"] * xi, values)
    turn = np.exp(1j * data.harmonic[:, None] * values["motion_phase"])
    motion = parts.pop("motion")
    by_displacement = values["contrast"] * turn * parts.pop("by_displacement")
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
