"""Fits of `femnl fit` to decays: one table of all, and a picture of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from femnl.cli._fixed import Texts, in_si
from femnl.cli._outcome import Outcome, record, show, with_error
from femnl.cli._output import note, table
from femnl.core.errors import MeasurementError

if TYPE_CHECKING:
    import xarray as xr
    from rich.console import Group

    from femnl.core.decay import DecayFit

FEW = 3
"""Decays that are shown with all their parameters; more get a row each."""


def decays(groups: Mapping[str, xr.Dataset], fixed: Texts, *, whole: bool) -> dict[str, Outcome]:
    """Fit every decay. One that cannot be fitted beside others is named and left out.

    Args: fixed: values that are held in each; whole: whether to show all parameters of each;
    `summary` shows a row each.
    """
    from femnl.fits.decay.power import fit_decay
    from femnl.observe.decay.law import UNITS

    fits: dict[str, DecayFit] = {}
    for name, dataset in groups.items():
        try:
            fits[name] = fit_decay(dataset, fixed=in_si(fixed, UNITS.get))
        except MeasurementError as error:
            if len(groups) == 1:
                raise
            note(f"{name}: {error}")
    if not fits:
        raise MeasurementError(f"none of the {len(groups)} decays can be fitted")
    return {
        name: Outcome(
            _record(fit, groups[name]),
            [*show(name, fit.fit), _phases(fit)] if whole else [],
            {"decay": fit.plot},
        )
        for name, fit in fits.items()
    }


def _record(fit: DecayFit, dataset: xr.Dataset) -> dict[str, Any]:
    """Return a fit as a JSON object, with its phases."""
    phases = [{"phase": p.name, "begin": p.begin, "end": p.end} for p in fit.phases]
    said = {"correlation": fit.correlation, "phases": phases}
    return record(fit.fit) | {"frequency": dataset.attrs.get("frequency")} | said


def _phases(fit: DecayFit) -> str:
    listed = ", ".join(f"{p.name} {p.begin:.4g} … {p.end:.4g}" for p in fit.phases)
    return f"  phases (s): {listed}"


def summary(records: Sequence[Mapping[str, Any]]) -> Group:
    """Return a table with a row for each decay, from the records of files."""
    rows = []
    for file in records:
        stem = Path(file["file"]).stem
        for name, fit in file["fits"].items():
            if "phases" in fit:
                own = name if len(records) == 1 else f"{stem}, {name}"
                rows.append(_row(own, fit))
    columns = ["decay", "f (Hz)", "Q", "± Q", "γ (1/s)", "± γ", "from … to (s)"]
    return table("1 decay" if len(rows) == 1 else f"{len(rows)} decays", columns, rows)


def _row(name: str, fit: Mapping[str, Any]) -> list[str]:
    rate = fit["parameters"]["decay_rate"]
    quality = fit["parameters"].get("quality_factor")
    decay = [phase for phase in fit["phases"] if phase["phase"] == "decay"]
    return [
        name,
        "–" if fit["frequency"] is None else f"{fit['frequency']:.9g}",
        *(("–", "–") if quality is None else with_error(quality["value"], quality["sd"])),
        *with_error(rate["value"], rate["sd"]),
        f"{decay[0]['begin']:.4g} … {decay[-1]['end']:.4g}",
    ]
