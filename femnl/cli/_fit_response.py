"""Fits of `femnl fit` to driven responses: all sweeps together, or place by place along a line."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

from femnl.cli._fixed import Texts, in_si
from femnl.cli._outcome import Outcome, record, show, with_error
from femnl.cli._output import note, table
from femnl.core.errors import ParameterError

if TYPE_CHECKING:
    import xarray as xr

    from femnl.core.choices import Background, Use
    from femnl.fits.response.result import ResponseFit

# χ²/ν, and relative width from which on a sweep may hold many modes
_MISFIT = 2.0
_WIDE = 0.05


@dataclass(frozen=True)
class Asked:
    """What the command line asks of a response; None and auto leave it to the data."""

    use: Use | None
    background: Background | Literal["auto"]
    linear: bool
    nonlinear_damping: bool
    fixed: Texts

    def in_si(self) -> dict[str, float]:
        """Return what is held, in SI."""
        from femnl.fits.response.result import bare_unit

        return in_si(self.fixed, bare_unit)

    def of_fit(self) -> dict[str, Any]:
        """Return the arguments of `fit_response`."""
        return {
            "use": self.use,
            "background": self.background,
            "duffing": False if self.linear else None,
            "nonlinear_damping": self.nonlinear_damping,
            "fixed": self.in_si(),
        }


def response(name: str, dataset: xr.Dataset, asked: Asked) -> dict[str, Outcome]:
    """Fit all sweeps at once."""
    import numpy as np

    from femnl.fits.response.fit import fit_response, predict_response
    from femnl.plot.response import response_figure

    fit = fit_response(dataset, **asked.of_fit())
    f = dataset["frequency"].values
    if fit.chi2_reduced > _MISFIT and np.nanmax(f) > (1 + _WIDE) * np.nanmin(f):
        note(
            f"{name}: one mode does not explain this wide sweep; --as overview finds its lines, "
            "--modes N fits so many"
        )
    return {
        name: Outcome(
            record(fit) | {"model": model_record(fit)},
            show(name, fit),
            {"fit": lambda: response_figure(dataset, predict_response(fit, dataset), fit.use)},
        )
    }


def model_record(fit: ResponseFit) -> dict[str, Any]:
    """Return what the evidence chose, for programs."""
    return {
        "background": fit.background,
        "background_grows_with_drive": fit.driven,
        "delay_of": fit.delayed,
        "duffing": fit.duffing,
        "phase_sign": fit.phase_sign,
        "errors": fit.errors,
        "use": fit.use,
        "criterion_above_the_best": fit.evidence,
    }


def each_sweep(name: str, dataset: xr.Dataset, asked: Asked) -> dict[str, Outcome]:
    """Fit every sweep on its own, and make a series of them."""
    from femnl.fits.response.each import fit_each_sweep
    from femnl.fits.response.fit import fit_response
    from femnl.observe.response.sweeps import first_harmonics
    from femnl.plot.measurement import series_figure

    fits, found = fit_each_sweep(dataset, partial(fit_response, **asked.of_fit()))
    kept, others = first_harmonics(dataset)
    controls = [str(key) for key in found.coords]
    rows = []
    for row, fit in enumerate(fits):
        frequency = fit.parameters["frequency"]
        quality = fit.parameters["quality_factor"]
        labels = [f"{float(found[key].values[row]):.6g}" for key in controls]
        numbers = [
            *with_error(frequency.value, frequency.sd),
            *with_error(quality.value, quality.sd),
        ]
        rows.append([str(kept[row] + 1), *labels, *numbers, f"{fit.chi2_reduced:.3g}"])
    heads = [f"{key.replace('_', ' ')} ({found[key].attrs['units']})" for key in controls]
    columns = ["sweep", *heads, "f (Hz)", "±", "Q", "± ", "χ²/ν"]
    sweeps = [record(fit) | {"model": model_record(fit)} for fit in fits]
    title = f"{name}: {len(fits)} sweeps, each fitted on its own"
    return {
        name: Outcome(
            {"sweeps": sweeps},
            [table(", ".join([title, *others]), columns, rows)],
            {"series": partial(series_figure, found)},
            {"series": found},
        )
    }


def modes(name: str, dataset: xr.Dataset, count: int, fixed: Texts) -> dict[str, Outcome]:
    """Fit a number of linear modes to every sweep."""
    from femnl.fits.response.modes import UNITS, fit_modes
    from femnl.observe.response.sweeps import first_harmonics
    from femnl.plot.response import response_figure

    outcomes = {}
    for sweep in first_harmonics(dataset)[0]:
        own = name if dataset.sizes["sweep"] == 1 else f"{name}, sweep {sweep + 1}"
        found = fit_modes(dataset, count, sweep, in_si(fixed, UNITS.get))
        one = dataset.isel(sweep=[sweep])
        fitted = one["frequency"].copy(data=found.prediction[None])
        outcomes[own] = Outcome(
            record(found.fit),
            show(own, found.fit),
            {"modes": partial(response_figure, one, fitted)},
        )
    return outcomes


def line_scan(name: str, dataset: xr.Dataset, asked: Asked) -> dict[str, Outcome]:
    """Fit every position on its own."""
    from femnl.fits.response.linescan import FIELDS, fit_line_scan
    from femnl.plot.linescan import line_scan_figure

    scan = fit_line_scan(
        dataset, asked.use, nonlinear_damping=asked.nonlinear_damping, fixed=asked.in_si()
    )
    if scan.sizes["position"] < 2:
        raise ParameterError(
            f"--as line-scan: all sweeps of {name} were taken at one place; fit them without it"
        )
    fields = [key for key in FIELDS if key in scan]
    rows = []
    for place in range(scan.sizes["position"]):
        at = scan.isel(position=place)
        row = [f"{round(float(at['x']) * 1e6, 4):.6g}", f"{round(float(at['y']) * 1e6, 4):.6g}"]
        for key in ("alpha_ratio", "alpha_y", "y_max"):
            if key in fields:
                row += with_error(float(at[key]), float(at[f"{key}_sd"]))
        rows.append([*row, f"{float(at['chi2_reduced']):.3g}"])
    named = {"alpha_ratio": "α_y/α_c", "alpha_y": "α_y (V⁻²)", "y_max": "y_max (V/V)"}
    columns = [
        "x (µm)",
        "y (µm)",
        *(word for key in named if key in fields for word in (named[key], "±" + " " * len(key))),
        "χ²/ν",
    ]
    mean, sd = with_error(scan.attrs["alpha_ratio"], scan.attrs["alpha_ratio_sd"])
    verdict = (
        f"  α_y/α_c = {mean} ± {sd} over all places at the drive {scan.attrs['drive']:g} V; they "
        "scatter about it with χ²/ν = "
    )
    values = {
        key: scan[key].values
        for key in ("x", "y", *(k for key in fields for k in (key, f"{key}_sd")), "chi2_reduced")
    }
    whole = {key: scan.attrs[key] for key in ("alpha_ratio", "alpha_ratio_sd", "scatter", "drive")}
    title = f"{name}: {len(rows)} places, each fitted on its own"
    return {
        name: Outcome(
            {"positions": values, "mean": whole, "uniform": bool(_uniform(scan))},
            [table(title, columns, rows), f"{verdict}{scan.attrs['scatter']:.3g}"],
            {"line-scan": partial(line_scan_figure, scan)},
        )
    }


def _uniform(scan: xr.Dataset) -> bool:
    """Whether the places scatter no more than three standard deviations of χ²/ν allow."""
    import numpy as np

    degrees = scan.sizes["position"] - 1
    return bool(scan.attrs["scatter"] < 1 + 3 * np.sqrt(2 / degrees))
