"""What each term of an oscillator's equation buys.

Fits with more and more of them, judged on the part held out.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from femnl.core.errors import MeasurementError
from femnl.core.fit import Fit
from femnl.core.kinds import function
from femnl.core.numbers import plain
from femnl.core.tables import Table, Tabulated
from femnl.fits.held import hold_fixed
from femnl.fits.record.oscillator import (
    LINEAR,
    fit_oscillator,
    refuse_uneven,
    settled,
    simulate_oscillator,
)
from femnl.observe.record.free_run import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ORDER = ("offset", "cubic", "quadratic", "nonlinear_damping")


@dataclass(frozen=True, eq=False)
class TermsFit(Tabulated):
    """One model: the terms beside m, c and k; its fit.

    Free-run error [unit of the output] (n,), and its rms fitted and held out.

    held_out is NaN where nothing was held out.
    """

    terms: tuple[str, ...]
    fit: Fit
    error: Array
    fitted: float
    held_out: float

    def __repr__(self) -> str:
        """The terms and the fit."""
        return f"<TermsFit with {self._name()}: {self.fit!r}>"

    def plot(self, data: xr.Dataset) -> "Figure":
        """Draw the output and the running rms error of the free run.

        Args: data: of kind `trace`, what was fitted.
        """
        draw = function("femnl.plot.decays:oscillator_figure")
        figure: Figure = draw(data, {self._name(): self.error})
        return figure

    def _name(self) -> str:
        return ", ".join(self.terms) or "linear terms"

    def _tables(self) -> list[Table]:
        held_out = "–" if np.isnan(self.held_out) else plain(self.held_out, 4)
        columns = {
            "samples": ["fitted", "held out"],
            "rms error (V)": [plain(self.fitted, 4), held_out],
        }
        return [Table(f"Oscillator with {self._name()}", columns), *self.fit._tables()]


def fit_terms(
    dataset: xr.Dataset,
    held_out: slice | None = None,
    fixed: Mapping[str, float] | None = None,
) -> list[TermsFit]:
    """Fit the oscillator of a `trace` with its drive.

    Linear, then with offset, k₃, k₂ and η added one after the other.

    The record need not begin at rest: its first decay times are simulated but neither fitted nor
    counted, nor are its last samples, see `settled`.
    Args: dataset of kind `trace`, one step, with `drive_voltage`; held_out: samples that no fit
    sees; fixed: values by parameter name, held in every model that has the parameter.
    Returns: the models by rising number of terms.
    Raises: MeasurementError without a drive, with several steps, or with fewer than 100 samples
    left to fit or to test; ParameterError for a name in `fixed` that is no parameter.
    """
    hold_fixed((*LINEAR, *ORDER), fixed, "an oscillator")
    if "drive_voltage" not in dataset or dataset.sizes["step"] != 1:
        raise MeasurementError(
            "trace: an oscillator is fitted to one step with its drive_voltage, here are "
            f"{dataset.sizes['step']} steps "
            f"{'with' if 'drive_voltage' in dataset else 'without'} it"
        )
    drive = dataset["drive_voltage"].values[0]
    output = dataset["voltage"].values[0]
    refuse_uneven(dataset["time"].values)
    rate = float(1 / np.median(np.diff(dataset["time"].values)))
    counted = settled(drive, output, rate)
    test = np.zeros_like(counted)
    if held_out is not None:
        test[held_out] = True
    n_fitted, n_tested = (int(np.count_nonzero(part)) for part in (counted & ~test, counted & test))
    if n_fitted < 100 or (held_out is not None and n_tested < 100):
        raise MeasurementError(
            f"trace: of {len(output)} samples {n_fitted} are left to fit and {n_tested} held out, "
            f"without the {np.count_nonzero(~counted)} in which the oscillator settles or the "
            "drive's spline ends; both need 100"
        )
    models: list[TermsFit] = []
    for count in range(len(ORDER) + 1):
        earlier = models[-1].fit if models else None
        own = (*LINEAR, *ORDER[:count])
        fit = fit_oscillator(
            drive,
            output,
            rate,
            ORDER[:count],
            fitted=counted & ~test,
            start=earlier,
            fixed={name: value for name, value in (fixed or {}).items() if name in own},
        )
        error = simulate_oscillator(fit, drive, rate) - output
        fitted, tested = (
            float(np.sqrt(np.mean(error[part] ** 2))) if part.any() else np.nan
            for part in (counted & ~test, counted & test)
        )
        models.append(
            TermsFit(ORDER[:count], fit, np.where(counted, error, np.nan), fitted, tested)
        )
    return models
