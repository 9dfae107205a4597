"""From a spectrum in a file to its model: which mode is which, and the speed of waves."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from femnl.core.checkpoint import Checkpoint
from femnl.core.effect import ParameterSpec
from femnl.core.errors import MeasurementError
from femnl.core.readout import Array
from femnl.fits.spectrum.labels import Named, named_modes
from femnl.observe.film import SimulatedFilm
from femnl.observe.spectrum.model import SpectrumModel, ranks

LEAST = 3
"""Usable modes that a diagnosis needs."""
THICKNESS_SD = 0.07
"""Relative standard deviation of a stated thickness: of a deposit, less what its release took."""
YOUNG_SD = 0.15
"""The same of a stated Young's modulus; values of nitride from the literature scatter by more
(Klaß et al., arXiv:2205.08907, figure 1).
"""
BENDING_SD = float(np.hypot(THICKNESS_SD, YOUNG_SD / 2))
"""The same of ℓ ∝ h √(E/σ), where the geometry gives all three; the stress is known better."""
FARTHEST = 4.0
"""How many of those ℓ may deviate."""
LATTICE = 4
"""Least number of holes that make a lattice."""


def pose(
    dataset: xr.Dataset, film: SimulatedFilm, checkpoint: Checkpoint | None = None
) -> SpectrumModel:
    """Return the model of a spectrum, whose base parameters are c and ℓ of the film.

    Raises: MeasurementError for fewer than three usable modes, and for labels that name no mode or
    one twice.
    """
    usable = np.isfinite(dataset["frequency"].values) & np.isfinite(dataset["frequency_sd"].values)
    frequency = dataset["frequency"].values[usable]
    if len(frequency) < LEAST:
        raise MeasurementError(
            f"spectrum: {len(frequency)} usable modes; a diagnosis needs at least {LEAST}"
        )
    label = dataset["label"].values[usable] if "label" in dataset else ()
    label = tuple(str(name) for name in label)
    named = named_modes(label, film) if label else Named(ranks(frequency), np.empty((0, 0)))
    order = named.order
    ratio = float(np.median(frequency / film.modes.frequency[order]))
    speed = film.speed * ratio
    bending_sd, low, high = _bending_prior(film)
    time = _times(dataset, usable)
    known = (
        "the geometry assumes its film, so ℓ is fitted without prior knowledge"
        if np.isinf(bending_sd)
        else f"ℓ is known to {BENDING_SD:.0%}"
    )
    return SpectrumModel(
        frequency=frequency,
        sd=dataset["frequency_sd"].values[usable],
        label=label,
        time=time,
        film=film,
        bending_sd=bending_sd,
        order=order,
        target=named.target,
        base=(
            ParameterSpec("speed", "m/s", 0.3 * speed, 3 * speed),
            ParameterSpec(
                "bending_length", "m", low * film.bending_length, high * film.bending_length
            ),
        ),
        start=np.array([speed, film.bending_length]),
        scales={
            "reach": film.projection.reach,
            "mass": float(film.modes.effective_mass[0] * (film.speed / speed) ** 2),
            "frequency": float(frequency.min()),
            "layer_square": film.bending_length**2,
            **_pitch(film.model.holes.centres),
            **({"time": float(np.ptp(time))} if len(time) and np.ptp(time) > 0 else {}),
        },
        notes=(f"spectrum: c is free, {known}; side, stress and density enter only through c/L",),
    )


def _bending_prior(film: SimulatedFilm) -> tuple[float, float, float]:
    """Return the relative standard deviation of ℓ, and its bounds in units of the geometry's ℓ.

    ℓ is not known where the geometry assumes thickness, modulus or stress.
    """
    keys = ("film", "film.thickness", "film.young", "film.stress")
    if any(key in keys for key in film.model.assumed):
        return np.inf, 0.0, 4.0
    # No fit may leave the prior of a known ℓ for what only another cause could do.
    reach = FARTHEST * BENDING_SD
    return BENDING_SD, 1 - reach, 1 + reach


def _pitch(centres: Array) -> dict[str, float]:
    """Return the square of the pitch [m²] as a scale, where there are holes (n, 2) [m]."""
    if len(centres) < LATTICE:
        return {}
    distance, _ = cKDTree(centres).query(centres, [2])
    return {"pitch_square": float(np.median(distance) ** 2)}


def _times(dataset: xr.Dataset, usable: NDArray[np.bool_]) -> Array:
    """Return when each usable mode was measured [s], empty where not all are known."""
    if "time" not in dataset:
        return np.empty(0)
    time = np.asarray(dataset["time"].values[usable])
    return time if np.isfinite(time).all() else np.empty(0)
