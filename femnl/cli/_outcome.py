"""What a fit hands to the command line.

Numbers for programs, tables for people, figures and files for a folder.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import TYPE_CHECKING, Any

from femnl.cli._output import scientific, table

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure
    from rich.console import Group

    from femnl.core.fit import Fit, Parameter


@dataclass(frozen=True)
class Outcome:
    """One result of a fit.

    The record that JSON prints, the text, figures by name (drawn when asked for), and a
    spectrum to write.
    """

    record: dict[str, Any]
    shown: list[Group | str]
    figures: Mapping[str, Callable[[], Figure]]
    spectra: Mapping[str, xr.Dataset] = field(default_factory=dict)


def record(fit: Fit) -> dict[str, Any]:
    """Return a fit as a JSON object."""
    parameters = {
        p.name: {"value": p.value, "sd": p.sd, "unit": p.unit} for p in fit.parameters.values()
    }
    return {
        "parameters": parameters,
        "chi2_reduced": fit.chi2_reduced,
        "n_points": fit.n_points,
        "notes": fit.notes,
    }


def show(name: str, fit: Fit) -> list[Group | str]:
    """Return a fit as a table under its name, and what there is to say of it."""
    rows = [
        [p.name, with_error(p.value, p.sd)[0], _error(p), p.unit or "–"]
        for p in fit.parameters.values()
    ]
    title = f"{name}: {fit.n_points} numbers, {fit.n_parameters} free parameters"
    if isfinite(fit.chi2_reduced):
        title += f", χ²/ν = {fit.chi2_reduced:.4g}"
    return [
        table(title, ["parameter", "value", "±", "unit"], rows),
        *(f"  {sentence}" for sentence in fit.notes),
    ]


def _error(parameter: Parameter) -> str:
    """Return the standard deviation as shown; what was held, and what follows from it, has none."""
    return "–" if parameter.sd == 0 else with_error(parameter.value, parameter.sd)[1]


def with_error(value: float, sd: float) -> tuple[str, str]:
    """Return a value to the digits that its standard deviation, given to two digits, leaves."""
    import numpy as np

    if value == 0 and np.isfinite(sd) and sd > 0:
        return "0", scientific(sd, 2)
    if not np.isfinite(sd) or sd <= 0 or value == 0:
        digits = 6 if np.isfinite(sd) or abs(value) < 1 else 9
        return scientific(value, digits), "unknown" if not np.isfinite(sd) else "0"
    digits = max(1, int(np.floor(np.log10(abs(value)))) - int(np.floor(np.log10(sd))) + 2)
    return scientific(value, digits), scientific(sd, 2)
