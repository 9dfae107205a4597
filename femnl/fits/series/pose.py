"""From a series in a file to its model; medians are the start."""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from femnl.core.checkpoint import Checkpoint
from femnl.core.device import Film
from femnl.core.effect import ParameterSpec
from femnl.core.errors import MeasurementError
from femnl.core.readout import Array
from femnl.io.measurement import CONTROLS, controls, estimate_noise
from femnl.mechanics.gas import crossing_time, free_molecular_loss
from femnl.observe.film import SimulatedFilm
from femnl.observe.series import KIND
from femnl.observe.series.model import SeriesModel

LEAST = 4
"""Usable points that a diagnosis needs."""
VACUUM = 8.8541878128e-12
"""Permittivity of vacuum [F/m]."""
FARTHEST = {"frequency": 2.0, "quality_factor": 10.0}
"""How far above all measured values a quantity may be without any cause: gas may damp all of them.
"""
QUANTITIES = {"frequency": "Hz", "quality_factor": "1"}
"""What a series may hold, with the unit of its constant."""


def pose(
    dataset: xr.Dataset, film: SimulatedFilm, checkpoint: Checkpoint | None = None
) -> SeriesModel:
    """Return the model of a series.

    Raises: MeasurementError for fewer than four usable points.
    """
    units = controls(dataset)
    control = {name: np.asarray(dataset[name].values, float) for name in units}
    data: dict[str, tuple[Array, Array]] = {}
    notes = []
    for name in QUANTITIES:
        if name in dataset:
            values = np.asarray(dataset[name].values, float)
            if not np.isfinite(values).any():
                continue
            sd, note = _standard_deviation(dataset, name)
            data[name] = (values, sd)
            notes += note
    used = np.concatenate([np.isfinite(values) & np.isfinite(sd) for values, sd in data.values()])
    if used.sum() < LEAST:
        raise MeasurementError(
            f"series: {used.sum()} usable points; a diagnosis needs at least {LEAST}"
        )
    middle = {name: float(np.nanmedian(values)) for name, (values, _) in data.items()}
    return SeriesModel(
        film=film.model.film,
        control=control,
        data=data,
        used=used,
        base=tuple(
            ParameterSpec(
                name,
                unit,
                0.5 * np.nanmin(data[name][0]),
                FARTHEST[name] * np.nanmax(data[name][0]),
            )
            for name, unit in QUANTITIES.items()
            if name in middle
        ),
        start=np.array(list(middle.values())),
        scales=_scales(control, middle) | _of_film(film, control, middle),
        notes=tuple(notes),
        units=units,
        gap=film.gap,
    )


def _standard_deviation(dataset: xr.Dataset, name: str) -> tuple[Array, list[str]]:
    """Return the standard deviation (n,) of a quantity, and a note where the file gives none."""
    if f"{name}_sd" in dataset:
        return np.asarray(dataset[f"{name}_sd"].values, float), []
    kept = dataset[[name]].assign_attrs(kind="series")
    sd = np.full(dataset[name].shape, estimate_noise(kept))
    return sd, [f"series: {name}_sd is not in the file; estimated from the scatter as {sd[0]:.3g}"]


def _scales(control: Mapping[str, Array], middle: Mapping[str, float]) -> dict[str, float]:
    """Return the range of each control variable that was varied, its inverse and their squares.

    A free one that is called as a number of another meaning, such as gap, is left out: effects ask
    for numbers by name.
    """
    # A control variable counts as recorded only where it was varied.
    taken = KIND.scales - CONTROLS.keys()
    varied = {
        name: float(np.ptp(values))
        for name, values in control.items()
        if name not in taken and np.isfinite(values).all() and np.ptp(values) > 0
    }
    return {
        **varied,
        **dict.fromkeys(middle, 1.0),
        **{f"per_{name}": 1 / size for name, size in varied.items()},
        **{f"per_{name}_square": 1 / size**2 for name, size in varied.items()},
    }


def _of_film(
    film: SimulatedFilm, control: Mapping[str, Array], middle: Mapping[str, float]
) -> dict[str, float]:
    """Return what the film and its gap say of the size of causes, where frequencies are known."""
    own = film.model.film
    found = {"thermal_stress": own.young / ((1 - own.poisson) * own.stress)}
    if np.isfinite(film.gap):
        found["gap"] = film.gap
    if "pressure" in control and (highest := float(np.nanmax(control["pressure"]))) > 0:
        found["highest_pressure"] = highest
    frequency = middle.get("frequency", float(film.modes.frequency[0]))
    found["crossing_time"] = crossing_time(film.model.outline)
    found["gas_loss"] = free_molecular_loss(own, frequency)
    if "voltage" in control:
        most = float(np.nanmax(np.abs(control["voltage"]))) or 1.0
        known = np.isfinite(film.gap)
        # Where the gap is not known, no more than pulls the film in at the highest voltage.
        found["electrostatic"] = _softening(own, film.gap, frequency) if known else 1 / most**2
    return found


def _softening(film: Film, gap: float, frequency: float) -> float:
    """Return −Δ(f²)/(f²V²) [1/V²] of a metal film over a metal wafer: ε₀/(ρhd³ω²)."""
    inertia = film.density * film.thickness * (2 * np.pi * frequency) ** 2
    return VACUUM / (inertia * gap**3)
