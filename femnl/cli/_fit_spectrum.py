"""Fits of `femnl fit` that compare lines with simulated modes: wide sweeps and spectra."""

from __future__ import annotations

from dataclasses import asdict, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from femnl.cli._fixed import Texts, in_si
from femnl.cli._outcome import Outcome, record, show, with_error
from femnl.cli._output import table
from femnl.core.errors import MeasurementError

if TYPE_CHECKING:
    import xarray as xr

    from femnl.core.device import Model
    from femnl.core.modes import Modes
    from femnl.core.spectrum import Assignment, Peaks

# simulated modes
_FIRST = 10
_MOST = 160
SLOW = 1e4  # Hz, below which frequencies are printed in Hz
# Of the highest frequency: as far the simulation goes, the stress of the film being uncertain
_BEYOND = 1.3


def overview(
    name: str, dataset: xr.Dataset, device: Model | None, cache: bool
) -> dict[str, Outcome]:
    """Find the lines of every sweep, and assign them to the modes of the device if there is one."""
    from femnl.fits.spectrum.overview import label_peaks, to_spectrum
    from femnl.fits.spectrum.peaks import find_peaks
    from femnl.plot.overview import overview_figure

    outcomes = {}
    for sweep in range(dataset.sizes["sweep"]):
        own = name if dataset.sizes["sweep"] == 1 else f"{name}, sweep {sweep + 1}"
        peaks = find_peaks(dataset, sweep)
        if peaks.frequency.size == 0:
            raise MeasurementError(
                f"{own}: no line stands out of the noise; average longer or drive harder"
            )
        found = None
        if device is not None:
            modes = _modes_up_to(device, peaks.band[1], cache)
            found = label_peaks(peaks, modes.label, modes.frequency)
        outcomes[own] = Outcome(
            _overview_record(peaks, found),
            _overview_shown(own, peaks, found),
            {"overview": partial(overview_figure, dataset, peaks, found, sweep)},
            {"spectrum": to_spectrum(peaks, found)},
        )
    return outcomes


def film(
    name: str, dataset: xr.Dataset, device: Model, cache: bool, fixed: Texts
) -> dict[str, Outcome]:
    """Fit the speed of waves in the film to a spectrum."""
    import numpy as np

    from femnl.fits.spectrum.film import UNITS, fit_film, need_assignable
    from femnl.mechanics.fem.laminate import as_in_spectra, keeps_layers, told_of_layers
    from femnl.plot.overview import film_figure

    need_assignable(dataset)
    device = as_in_spectra(device)
    modes = _modes_up_to(device, float(np.nanmax(dataset["frequency"].values)), cache)
    held = in_si(fixed, UNITS.get)
    found = fit_film(dataset, modes.label, modes.frequency, device.film, held)
    if keeps_layers(device):
        notes = (*found.fit.notes, told_of_layers(device))
        found = replace(found, fit=replace(found.fit, notes=notes))
    # Sub-kilohertz modes in Hz
    divisor, unit = (1e6, "MHz") if np.max(found.frequency) >= SLOW else (1.0, "Hz")
    rows = [
        [
            label,
            f"{f / divisor:.6f}",
            f"{g * found.fit['scale'] / divisor:.6f}",
            f"{away * 1e6:.1f}",
            f"{sd / f * 1e6:.1f}",
        ]
        for label, f, g, away, sd in zip(
            found.label,
            found.frequency,
            found.simulated,
            found.deviation,
            found.frequency_sd,
            strict=True,
        )
    ]
    columns = ["mode", f"f ({unit})", f"simulated, scaled ({unit})", "away (ppm)", "± (ppm)"]
    said = [] if found.assignment is None else _said(found.assignment)
    modes_record = {
        key: list(getattr(found, key))
        for key in ("label", "frequency", "frequency_sd", "simulated", "deviation")
    }
    chosen: dict[str, Any] = (
        {} if found.assignment is None else {"assignment": _assignment_record(found.assignment)}
    )
    return {
        name: Outcome(
            record(found.fit) | modes_record | chosen,
            [*show(name, found.fit), table("", columns, rows), *said],
            {"film": partial(film_figure, found)},
        )
    }


def _modes_up_to(device: Model, highest: float, cache: bool) -> Modes:
    """Return so many modes that the simulation reaches a little beyond the highest measured one."""
    from femnl.mechanics.fem.laminate import keeps_layers
    from femnl.pipeline import solve_modes

    count = _FIRST
    tell = not keeps_layers(device)  # else a note of the fit says it
    modes = solve_modes(device, count, cache=cache, tell=tell)
    while modes.frequency[-1] < _BEYOND * highest and count < _MOST:
        count = min(2 * count, _MOST)
        modes = solve_modes(device, count, cache=cache, tell=tell)
    return modes


def _overview_record(peaks: Peaks, found: Assignment | None) -> dict[str, Any]:
    import numpy as np

    names = (
        "frequency",
        "frequency_sd",
        "linewidth",
        "linewidth_sd",
        "quality_factor",
        "quality_factor_sd",
        "amplitude_sd",
    )
    lines = {name: getattr(peaks, name) for name in names} | {"amplitude": np.abs(peaks.amplitude)}
    result: dict[str, Any] = {
        "lines": lines,
        "band": peaks.band,
        "chi2_reduced": peaks.chi2_reduced,
        "notes": peaks.notes,
    }
    return result if found is None else result | {"assignment": _assignment_record(found)}


def _assignment_record(found: Assignment) -> dict[str, Any]:
    kept = {key: value for key, value in asdict(found).items() if key not in ("best", "runner_up")}
    rival = (
        None
        if found.runner_up is None
        else {"label": found.runner_up.label, "probability": found.runner_up.probability}
    )
    return {
        "label": found.best.label,
        "probability": found.best.probability,
        "runner_up": rival,
    } | kept


def _overview_shown(name: str, peaks: Peaks, found: Assignment | None) -> list[Any]:
    import numpy as np

    labels = (
        ["–"] * peaks.frequency.size
        if found is None
        else [label or "none" for label in found.best.label]
    )
    away = np.full(peaks.frequency.size, np.nan) if found is None else found.deviation
    rows = []
    for k, label in enumerate(labels):
        f, f_sd = with_error(peaks.frequency[k], peaks.frequency_sd[k])
        q, q_sd = with_error(peaks.quality_factor[k], peaks.quality_factor_sd[k])
        ppm = "–" if np.isnan(away[k]) else f"{away[k] * 1e6:.0f}"
        rows.append([label, f, f_sd, q, q_sd, f"{abs(peaks.amplitude[k]) * 1e3:.4g}", ppm])
    title = f"{name}: {peaks.frequency.size} lines, χ²/ν = {peaks.chi2_reduced:.4g}"
    columns = ["mode", "f (Hz)", "±", "Q", "± ", "height (mV)", "away (ppm)"]
    said = (
        ["no device is named, so lines carry no labels; give --geometry"]
        if found is None
        else _said(found)
    )
    return [table(title, columns, rows), *(f"  {sentence}" for sentence in [*said, *peaks.notes])]


def _said(found: Assignment) -> list[str]:
    """Return sentences on an assignment: how probable, what else, what is missing."""
    scale, sd = with_error(found.scale, found.scale_sd)
    whole = (
        f", {found.up_to_ambiguous:.3g} up to the modes named below that are hardly distinguishable"
        if found.ambiguous
        else ""
    )
    said = [
        f"probability of this assignment {found.best.probability:.3g}{whole}; measured over "
        f"simulated frequency {scale} ± {sd}, modes scatter by {found.model_sd * 1e6:.0f} ppm"
    ]
    if found.runner_up is not None:
        changed = [
            f"{one or 'none'} → {other or 'none'}"
            for one, other in zip(found.best.label, found.runner_up.label, strict=True)
            if one != other
        ]
        said.append(
            f"runner-up, probability {found.runner_up.probability:.2g}: {', '.join(changed)}"
        )
    if found.missing:
        said.append(f"modes of this range without a line: {', '.join(found.missing)}")
    said += [
        f"frequencies alone hardly tell apart: {', '.join(group)}" for group in found.ambiguous
    ]
    return said
