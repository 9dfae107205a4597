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
from femnl.fits.spectrum.without_labels import modes_of
from femnl.mechanics.gas import crossing_time, free_molecular_loss
from femnl.observe.film import SimulatedFilm
from femnl.observe.spectrum.model import SpectrumModel

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
LOSS = (1e-7, 1e-1)
"""Loss angles of bending: from that of crystals at low temperature to that of a lossy polymer."""
ATMOSPHERE = 1.05e5
"""Highest pressure [Pa] of a gas where the file gives none."""
FARTHEST = 4.0
"""How many of those ℓ may deviate."""
ONE_LOSS = "spectrum: one loss angle of bending stands for the film and its layers"
"""What a diagnosis tells of quality factors where layers lie on the film."""
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
    sd = dataset["frequency_sd"].values[usable]
    told_of_modes: tuple[str, ...] = ()
    if label:
        named = named_modes(label, film)
    else:
        modes, told_of_modes = modes_of(frequency, sd, film)
        named = Named(modes, np.empty((0, film.count)))
    order = named.order
    ratio = float(np.median(frequency / film.modes.frequency[order]))
    speed = film.speed * ratio
    bending_sd, low, high = _bending_prior(film)
    time = _times(dataset, usable)
    quality, quality_sd = _quality_factors(dataset, usable)
    rated = np.isfinite(quality) & np.isfinite(quality_sd)
    pressure = float(dataset.attrs.get("pressure", 0.0))
    known_speed = _known_speed(dataset)
    told = (
        "c is free"
        if known_speed is None
        else f"c is {known_speed[0]:.6g} ± {known_speed[1]:.2g} m/s"
    )
    known = (
        "the geometry assumes its film, so ℓ is fitted without prior knowledge"
        if np.isinf(bending_sd)
        else f"ℓ is known to {BENDING_SD:.0%}"
    )
    return SpectrumModel(
        frequency=frequency,
        sd=sd,
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
            *((ParameterSpec("intrinsic_loss", "1", *LOSS, log=True),) if rated.any() else ()),
        ),
        start=np.array([speed, film.bending_length, *_loss(film, order, quality, rated)]),
        scales={
            "reach": film.projection.reach,
            "mass": float(film.modes.effective_mass[0] * (film.speed / speed) ** 2),
            "frequency": float(frequency.min()),
            "layer_square": film.bending_length**2,
            **_pitch(film.model.holes.centres),
            **({"time": float(np.ptp(time))} if len(time) and np.ptp(time) > 0 else {}),
            "highest_pressure": pressure or ATMOSPHERE,
            "crossing_time": crossing_time(film.model.outline),
            **({"gap": film.gap} if np.isfinite(film.gap) else {}),
            **({"layer_thickness": 1.0} if film.layered else {}),
            **({"quality_factor": 1.0} if rated.any() else {}),
            **(_gas(film, float(frequency.min()), pressure) if pressure else {}),
        },
        notes=(
            f"spectrum: {told}, {known}; side, stress and density enter only through c/L",
            *told_of_modes,
            *film.notes,
            *([ONE_LOSS] if film.layered and rated.any() else []),
        ),
        quality_factor=quality,
        quality_factor_sd=quality_sd,
        pressure=pressure,
        known_speed=known_speed,
    )


def _known_speed(dataset: xr.Dataset) -> tuple[float, float] | None:
    """Return c and its standard deviation where the file tells them.

    Raises: MeasurementError where it tells one of them alone.
    """
    given = [name for name in ("wave_speed", "wave_speed_sd") if name in dataset.attrs]
    if not given:
        return None
    if len(given) == 1:
        raise MeasurementError(
            f"spectrum: {given[0]} is alone; give wave_speed and wave_speed_sd [m/s], or neither"
        )
    return float(dataset.attrs["wave_speed"]), float(dataset.attrs["wave_speed_sd"])


def _quality_factors(dataset: xr.Dataset, usable: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return quality factors and their sd of the usable modes, NaN unless a mode has both."""
    names = ("quality_factor", "quality_factor_sd")
    if any(name not in dataset for name in names):
        return np.empty(0), np.empty(0)
    values, sd = (np.asarray(dataset[name].values, float)[usable] for name in names)
    return values, sd


def _loss(
    film: SimulatedFilm, order: NDArray[np.int64], quality: Array, rated: NDArray[np.bool_]
) -> list[float]:
    """Return the loss angle of bending to start from, [] where no quality factor is known."""
    if not rated.any():
        return []
    share = film.bending_share[order[rated]]
    return [float(np.clip(np.median(1 / (quality[rated] * share)), *LOSS))]


def _gas(film: SimulatedFilm, frequency: float, pressure: float) -> dict[str, float]:
    """Return the scales of a spectrum that was taken in gas of known pressure."""
    loss = free_molecular_loss(film.model.film, frequency)
    return {"pressure": pressure, "gas_loss": loss}


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
