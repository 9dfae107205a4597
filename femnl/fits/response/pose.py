"""From driven sweeps in a file to their model: the Duffing mode that fits them first."""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from femnl.core.checkpoint import Checkpoint
from femnl.core.effect import ParameterSpec
from femnl.core.errors import MeasurementError
from femnl.core.readout import Array
from femnl.fits.outliers import MOST_GLITCHES
from femnl.fits.response.choice import CONJUGATED, turned
from femnl.fits.response.first_fit import first_fit
from femnl.fits.response.spikes import without_spikes
from femnl.mechanics.modes import shape_at
from femnl.observe.film import SimulatedFilm
from femnl.observe.response.extent import extent
from femnl.observe.response.model import ALPHA_SD, ResponseModel
from femnl.observe.response.sweeps import Sweeps, collect
from femnl.observe.response.timing import timing

WIDER = 20.0
"""How far from the first fit, as a factor, linewidth, motion and height may be."""
LARGER = 2.0
"""How often as strong as the background that hides the resonance backgrounds may be."""


def pose(
    dataset: xr.Dataset, film: SimulatedFilm, checkpoint: Checkpoint | None = None
) -> ResponseModel:
    """Return the model of driven sweeps: one Duffing mode with linear readout.

    Raises: MeasurementError where the file names a mode that the film does not have.
    """
    sweeps = collect(dataset)
    if not sweeps.phases:
        raise MeasurementError(
            "response: it holds magnitudes alone, and a diagnosis needs both quadratures; measure "
            "them, or use femnl fit, which takes magnitudes"
        )
    count = sweeps.n_positions
    place = ("",) if count == 1 else tuple(f"[{p}]" for p in range(count))
    sign, fitted = first_fit(without_spikes(dataset, sweeps.noise), place, checkpoint)
    sweeps = turned(sweeps, sign)
    mode = _mode(dataset, film, fitted["frequency"])
    alpha = float(film.alpha[mode])
    slope = [fitted[f"y_max{name}"] for name in place]
    ratio = fitted[f"alpha_y{place[0]}"]
    metre = float(np.sqrt(alpha / abs(ratio))) if ratio else slope[0] / 1e-7
    peak = slope[0] / metre
    leak = max(slope[0], LARGER * fitted["background"], _highest(sweeps))
    softens = fitted["softens"] > 0
    gains = np.array(slope) / peak
    everywhere = extent(sweeps, gains, np.ones(len(sweeps.frequency), dtype=bool))
    when = timing(dataset, sweeps)
    wavelength = float(dataset.attrs.get("wavelength", 0.0))
    base, start = _base(fitted, sweeps.span, peak, slope, place)
    return ResponseModel(
        sweeps=sweeps,
        wavelength=wavelength,
        mode=mode,
        simulated_alpha=alpha,
        softens=softens,
        place=place,
        time=when.time,
        step=when.step,
        shape=_shape(dataset, sweeps, film, mode),
        middle=everywhere.middle,
        largest=everywhere.largest,
        base=base,
        start=start,
        scales={
            "curvature": (peak * sweeps.reference) ** -2,
            "curvature_square": (peak * sweeps.reference) ** -4,
            "slope": leak,
            "slope_per_span": leak / sweeps.span,
            "span": sweeps.span,
            "stiffening_square": abs(alpha) / everywhere.motion**2,
            "drive_square": sweeps.reference**-2,
            "frequency": fitted["frequency"],
            "linewidth": fitted["linewidth"],
            "linewidth_square": fitted["linewidth"] ** 2,
            "moving": everywhere.width,
            **({"wavelength": wavelength} if wavelength else {}),
            **({"direction": 1.0} if all(sweeps.direction) else {}),
            **({"time": float(np.ptp(when.time))} if when.recorded else {}),
        },
        notes=_notes(
            (*sweeps.notes, *when.notes, *([CONJUGATED] if sign < 0 else [])),
            film.modes.label[mode] or str(mode + 1),
            alpha,
            softens,
        ),
        hidden=fitted["hidden"] > 0,
    )


def _highest(sweeps: Sweeps) -> float:
    """Return the largest voltage by the drive at the first place [V/V], but for glitches.

    No leak is larger, while one that distorts the fit of the resonance may be larger than that fit.
    """
    here = sweeps.position == 0
    by_drive = np.abs(sweeps.voltage[here]) / sweeps.drive[here]
    return float(np.quantile(by_drive, 1 - MOST_GLITCHES)) / sweeps.reference


def _base(
    fitted: Mapping[str, float],
    span: float,
    peak: float,
    height: list[float],
    place: tuple[str, ...],
) -> tuple[tuple[ParameterSpec, ...], Array]:
    """Return the parameters of the base model with their ranges, and where they start.

    The height of a resonance is free of how far the mode moves, which shows in how it bends alone:
    a linear mode has no peak that the data know, and the same height.

    span [Hz]: of the sweeps. peak [m/V], height [V/V]: linear amplitude at resonance by the drive,
    and what is read of it at each place.
    """
    f0 = fitted["frequency"]
    width = fitted["linewidth"]
    phases = [fitted[f"phase{name}"] for name in place]
    base = (
        ParameterSpec("frequency", "Hz", max(f0 - span, f0 / WIDER), f0 + span),
        ParameterSpec("linewidth", "Hz", width / WIDER, WIDER * width),
        ParameterSpec("peak", "m/V", 0.0, WIDER * peak),
        *(
            ParameterSpec(f"height{name}", "V/V", 0.0, WIDER * size)
            for name, size in zip(place, height, strict=True)
        ),
        *(
            ParameterSpec(f"phase{name}", "rad", phase - np.pi, phase + np.pi)
            for name, phase in zip(place, phases, strict=True)
        ),
    )
    return base, np.array([f0, width, peak, *height, *phases])


def _shape(dataset: xr.Dataset, sweeps: Sweeps, film: SimulatedFilm, mode: int) -> Array:
    """Return ξ of the driven mode at the place of each point, 1 where the file has no places."""
    if "x" not in dataset or "y" not in dataset:
        return np.ones(len(sweeps.frequency))
    places = shape_at(film.modes, mode, sweeps.positions[:, 0], sweeps.positions[:, 1])
    return np.asarray(places[sweeps.position])


def _notes(notes: tuple[str, ...], label: str, alpha: float, softens: bool) -> tuple[str, ...]:
    """Return what a report says of the sweeps, and of what metres rest on."""
    soft = (
        "response: the sweeps soften, which the geometry alone cannot do; in their metres α "
        "is as large as simulated, but negative where no other mode pulls"
    )
    return (
        *(f"response: {note}" for note in notes),
        *([soft] if softens else []),
        f"response: metres rest on the simulated α of mode {label}, {alpha:.3g} m⁻², known to "
        f"{ALPHA_SD:.0%}",
    )


def _mode(dataset: xr.Dataset, film: SimulatedFilm, frequency: float) -> int:
    """Return the mode that the file names, or else the one nearest in frequency."""
    named = dataset.attrs.get("mode")
    if named is None:
        return int(np.argmin(np.abs(film.modes.frequency - frequency)))
    label = f"({str(named).strip('()')})"
    if label not in film.modes.label:
        raise MeasurementError(
            f"response: mode = {named!r} is none of the first {len(film.modes.label)} modes of "
            f"{film.model.name}; correct it"
        )
    return film.modes.label.index(label)
