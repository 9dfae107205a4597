"""From a map in a file to its model: the mode that it shows, fitted under a sine."""

from collections.abc import Sequence
from functools import partial

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from femnl.core.checkpoint import Checkpoint
from femnl.core.effect import ParameterSpec
from femnl.core.readout import Array
from femnl.fits.map.fit import fit_map
from femnl.io.measurement import noise_sd
from femnl.observe.film import SimulatedFilm
from femnl.observe.map.model import MapModel, exact_shapes
from femnl.observe.map.spots import Grid
from femnl.optics.airy import stack_scales

TRIED = 6
"""Lowest modes that a map without drive frequency may show."""
COARSE = 24
"""Points along each axis of the thinned map in which the mode is sought."""
EXPLAINED = 0.1
"""Part of the signal's power that the right mode may leave; wrong ones leave a third and more."""
NEAR = 0.1
"""Relative distance of a mode's simulated frequency from the drive up to which it may be the one
that is driven.
"""
FITTED = ("amplitude", "contrast", "fringe_phase", "motion_phase", "x", "y")
"""Parameters of a fitted map, in the order of the model's."""


def pose(
    dataset: xr.Dataset, film: SimulatedFilm, checkpoint: Checkpoint | None = None
) -> MapModel:
    """Return the model of a map of harmonics.

    Its mode is the one near the frequency of the drive that fits best.
    """
    values = np.asarray(dataset["real"].values + 1j * dataset["imag"].values)
    harmonic = dataset["harmonic"].values.astype(np.int64)
    values = values[harmonic >= 1]
    harmonic = harmonic[harmonic >= 1]
    flat = values.reshape(len(harmonic), -1)
    used = np.flatnonzero(np.isfinite(flat).any(axis=0))
    present = np.isfinite(flat[:, used])
    measured = np.where(present, flat[:, used], 0)
    noise, note = noise_sd(dataset)
    stated = dataset.attrs.get("drive_frequency")
    power = float(np.mean(np.abs(measured[present]) ** 2) / (2 * noise**2))
    driven = None if stated is None else float(stated)
    near = _near(film, driven)
    mode, fitted = _find_mode(dataset.assign_attrs(noise_sd=noise), film, near, power)
    why = "near the drive frequency" if near else "the first that fits"
    frequency = float(film.modes.frequency[mode]) if driven is None else driven
    # Without a drive, as where heat moves the film, its size is 1 in whatever unit
    drive = abs(float(dataset.attrs.get("drive", 1.0))) or 1.0
    wavelength = float(dataset.attrs["wavelength"])
    time = _time(dataset, used)
    x = np.asarray(dataset["x"].values, float)
    y = np.asarray(dataset["y"].values, float)
    return MapModel(
        film=film,
        wavelength=wavelength,
        harmonic=harmonic,
        axes=(x, y),
        grid=_grid(x, y, used),
        present=present,
        measured=measured,
        time=time,
        noise=noise,
        mode=mode,
        frequency=frequency,
        drive=drive,
        base=_base(fitted, wavelength, film.projection.reach),
        start=np.array([fitted[name] for name in FITTED]),
        scales={
            "reach": film.projection.reach,
            "wavelength": wavelength,
            "slope": abs(fitted["contrast"]) / drive,
            "period": 1 / frequency,
            **({"time": float(np.ptp(time))} if len(time) else {}),
            **stack_scales(film.model.stack),
        },
        notes=(
            f"map: {note}",
            f"map: shows mode {film.modes.label[mode] or str(mode + 1)}, {why}",
        ),
    )


def _grid(x: Array, y: Array, used: NDArray[np.intp]) -> Grid:
    """Return the places with data; used (n_points,): their indices in the flattened map."""
    across, up = np.meshgrid(x, y)
    row, column = np.divmod(used, len(x))
    return Grid(across.ravel()[used], up.ravel()[used], row, column, (len(y), len(x)))


def _time(dataset: xr.Dataset, used: NDArray[np.intp]) -> Array:
    """Return when each place with data was measured [s]; empty where the file does not say so."""
    if "time" not in dataset:
        return np.empty(0)
    time = np.asarray(dataset["time"].values, float).ravel()[used]
    told = bool(np.isfinite(time).all()) and np.ptp(time) > 0
    return time if told else np.empty(0)


def _base(fitted: dict[str, float], wavelength: float, reach: float) -> tuple[ParameterSpec, ...]:
    """Return the parameters of the base model with their ranges about a first fit."""
    strongest = 10 * abs(fitted["contrast"])
    theta = fitted["fringe_phase"]
    phase = fitted["motion_phase"]
    return (
        ParameterSpec("amplitude", "m", 0.0, 40 * (wavelength / (4 * np.pi))),
        ParameterSpec("contrast", "V", -strongest, strongest),
        ParameterSpec("theta", "rad", theta - np.pi, theta + np.pi),
        ParameterSpec("motion_phase", "rad", phase - np.pi, phase + np.pi),
        ParameterSpec("x", "m", -0.3 * reach, 0.3 * reach),
        ParameterSpec("y", "m", -0.3 * reach, 0.3 * reach),
    )


def _near(film: SimulatedFilm, driven: float | None) -> list[int]:
    """Return the modes near the frequency of the drive [Hz], none where it is not known."""
    if driven is None:
        return []
    return [int(k) for k in np.flatnonzero(np.abs(driven / film.modes.frequency - 1) < NEAR)]


def _find_mode(
    dataset: xr.Dataset, film: SimulatedFilm, near: Sequence[int], power: float
) -> tuple[int, dict[str, float]]:
    """Return the mode whose shape fits a thinned map best, with its fit.

    near: modes that may be driven; the lowest are tried where there are none. power: mean square of
    the signal, in that of the noise.
    """
    measured = np.isfinite(dataset["real"].values)
    rows = np.flatnonzero(measured.any(axis=(0, 2)))
    dataset = dataset.isel(y=rows, x=np.flatnonzero(measured.any(axis=(0, 1))))
    thin = {axis: slice(None, None, max(1, dataset.sizes[axis] // COARSE)) for axis in ("x", "y")}
    coarse = dataset.isel(thin).isel(harmonic=np.flatnonzero(dataset["harmonic"].values >= 1))
    exact = exact_shapes(film)

    def shape(k: int, x: Array, y: Array) -> Array:
        return np.asarray((exact or film.projection.at)(x, y)[k])

    fits = {}
    for k in near or range(TRIED):
        fits[k] = fit_map(coarse, partial(shape, k), registration=("x", "y")).fit
        if fits[k].chi2_reduced < EXPLAINED * power:
            break
    best = min(fits, key=lambda k: fits[k].chi2_reduced)
    return best, _upright({name: p.value for name, p in fits[best].parameters.items()})


def _upright(found: dict[str, float]) -> dict[str, float]:
    """Choose between two motions that read the same, u at a fringe phase θ and −u at −θ.

    Take the one within a quarter turn of the drive.
    """
    phase = (found["motion_phase"] + np.pi / 2) % (2 * np.pi) - np.pi / 2
    if phase <= np.pi / 2:
        return found | {"motion_phase": phase}
    turned = (np.pi - found["fringe_phase"]) % (2 * np.pi) - np.pi
    return found | {"motion_phase": phase - np.pi, "fringe_phase": turned}
