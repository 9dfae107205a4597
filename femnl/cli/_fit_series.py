"""Fits of `femnl fit` to series: a law of frequency and quality factor."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from femnl.cli._fixed import Texts, in_si
from femnl.cli._outcome import Outcome, record, show
from femnl.cli._output import scientific

if TYPE_CHECKING:
    import xarray as xr

    from femnl.core.choices import Law


def law(
    name: str, dataset: xr.Dataset, form: Law, control: str | None, fixed: Texts
) -> dict[str, Outcome]:
    """Fit a law to every quantity of a series, against one control variable."""
    from femnl.fits.series.law import fit_series, parameter_units
    from femnl.plot.series import series_fit_figure

    units = parameter_units(dataset, form, control)
    outcomes = {}
    for found in fit_series(dataset, form, control, in_si(fixed, units.get)):
        own = f"{name}, {found.quantity.replace('_', ' ')}"
        ends = [
            f"  95 %: {key} from {scientific(low, 6)} to {scientific(high, 6)}"
            for key, (low, high) in found.interval.items()
        ]
        outcomes[own] = Outcome(
            record(found.fit)
            | {
                "law": found.law,
                "quantity": found.quantity,
                "control": found.control,
                "interval_95": {key: list(ends) for key, ends in found.interval.items()},
            },
            [*show(own, found.fit), *ends],
            {found.law: partial(series_fit_figure, found)},
        )
    return outcomes
