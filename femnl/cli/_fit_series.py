"""Fits of `femnl fit` to series: a law of frequency and quality factor."""

from __future__ import annotations

from functools import partial
from math import floor, log10
from typing import TYPE_CHECKING

from femnl.cli._fixed import Texts, in_si
from femnl.cli._outcome import Outcome, record, show
from femnl.cli._output import scientific

if TYPE_CHECKING:
    import xarray as xr

    from femnl.core.choices import Law


LEAST_DIGITS = 6
MOST_DIGITS = 15


def _digits(low: float, high: float) -> int:
    """Return how many digits tell the ends of an interval apart, by two at least."""
    if not high > low:
        return LEAST_DIGITS
    width = (high - low) / max(abs(low), abs(high))
    return max(LEAST_DIGITS, min(MOST_DIGITS, 2 - floor(log10(width))))


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
            f"  95 %: {key} from {scientific(low, digits)} to {scientific(high, digits)}"
            for key, (low, high) in found.interval.items()
            for digits in [_digits(low, high)]
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
