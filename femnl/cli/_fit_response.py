"""Fits of `femnl fit` to driven responses: all sweeps together, or place by place along a line."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from femnl.cli._outcome import Outcome, record, show, with_error
from femnl.cli._output import note, table
from femnl.core.errors import ParameterError

if TYPE_CHECKING:
    import xarray as xr

    from femnl.core.choices import Use

# χ²/ν, and relative width from which on a sweep may hold many modes
_MISFIT = 2.0
_WIDE = 0.05


def response(
    name: str, dataset: xr.Dataset, use: Use, nonlinear_damping: bool
) -> dict[str, Outcome]:
    """Fit all sweeps at once."""
    import numpy as np

    from femnl.fits.response.fit import fit_response, predict_response
    from femnl.plot.response import response_figure

    fit = fit_response(dataset, use, nonlinear_damping=nonlinear_damping)
    f = dataset["frequency"].values
    if fit.chi2_reduced > _MISFIT and np.nanmax(f) > (1 + _WIDE) * np.nanmin(f):
        note(f"{name}: one mode does not explain this wide sweep; --as overview finds its lines")
    return {
        name: Outcome(
            record(fit),
            show(name, fit),
            {"fit": lambda: response_figure(dataset, predict_response(fit, dataset), use)},
        )
    }


def line_scan(
    name: str, dataset: xr.Dataset, use: Use, nonlinear_damping: bool
) -> dict[str, Outcome]:
    """Fit every position on its own."""
    from femnl.fits.response.linescan import FIELDS, fit_line_scan
    from femnl.plot.linescan import line_scan_figure

    scan = fit_line_scan(dataset, use, nonlinear_damping=nonlinear_damping)
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
    named = {"alpha_ratio": "α_y/α_c", "alpha_y": "α_y (V²/V²)", "y_max": "y_max (V/V)"}
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
