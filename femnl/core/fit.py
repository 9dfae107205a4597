"""Results of fits: parameters in SI with standard deviations, and how well the data are met."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import hypot
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from femnl.core.arrays import freeze
from femnl.core.errors import ParameterError
from femnl.core.kinds import function
from femnl.core.numbers import measured
from femnl.core.tables import Table, Tabulated, dataframe, dataset

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

    from femnl.core.readout import HarmonicSpectrum


@dataclass(frozen=True)
class Parameter:
    """One fitted number in `unit`.

    value, and standard deviation sd (68 % where normal; inf where the data say nothing).
    equation_sd: what the inexact equations of named causes add to it, in quadrature.
    """

    name: str
    value: float
    sd: float
    unit: str
    equation_sd: float = 0.0

    @property
    def whole_sd(self) -> float:
        """√(sd² + equation_sd²)."""
        return hypot(self.sd, self.equation_sd)


def parameter_columns(parameters: Iterable[Parameter]) -> dict[str, list[str]]:
    """Return names, values ± standard deviations to two digits, and units as texts."""
    listed = list(parameters)
    return {
        "parameter": [p.name for p in listed],
        "value": measured([p.value for p in listed], [p.sd for p in listed]),
        "unit": ["" if p.unit == "1" else p.unit for p in listed],
    }


@dataclass(frozen=True)
class Fit(Tabulated):
    """The outcome of a least-squares fit.

    parameters: by name, the free ones first and in the order of `covariance`, then derived ones.
    covariance (n_parameters, n_parameters) in SI. chi2_reduced = χ²/(n_points − n_parameters),
    n_points counting real numbers.
    notes: sentences for the report: what was assumed, estimated, left out, or cannot be
    distinguished.
    """

    parameters: dict[str, Parameter]
    covariance: NDArray[np.float64]
    chi2_reduced: float
    n_points: int
    n_parameters: int
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        freeze(self)

    def __repr__(self) -> str:
        """Every parameter with its standard deviation, and how well the data are met."""
        found = ", ".join(
            f"{p.name} = {p.value:.7g} ± {p.sd:.2g} {p.unit}".rstrip()
            for p in self.parameters.values()
        )
        return f"<Fit: {found}; χ²/ν = {self.chi2_reduced:.4g} of {self.n_points} numbers>"

    def __getitem__(self, name: str) -> float:
        """Return the value of the parameter called `name`."""
        return self.parameters[name].value

    def plot(self, data: "xr.Dataset") -> "Figure":
        """Draw the fit of a driven response or of a free decay beside its data.

        Args: data: what was fitted: of kind `response`, or of kind `trace` with one step.
        Raises: ParameterError for a fit or data of another kind.
        """
        figure: Figure = function("femnl.plot.fits:fit_figure")(self, data)
        return figure

    def to_dataframe(self) -> "pd.DataFrame":
        """Return a row a parameter with its value and sd, in SI, and their unit."""
        import pandas as pd

        listed = self.parameters.values()
        columns = {
            "value": [p.value for p in listed],
            "sd": [p.sd for p in listed],
            "unit": [p.unit for p in listed],
        }
        return pd.DataFrame(columns, index=pd.Index([p.name for p in listed], name="parameter"))

    def _tables(self) -> list[Table]:
        title = f"Fit of {self.n_points} numbers by {self.n_parameters} free parameters"
        title += f", χ²/ν = {self.chi2_reduced:.4g}"
        return [Table(title, parameter_columns(self.parameters.values()), self.notes)]


@dataclass(frozen=True)
class MapFit(Tabulated):
    """A fit of harmonic maps, and by name of the map what it predicts and what it leaves.

    prediction: V_n [V], complex (n_harmonics, n_y, n_x); residual: (data − prediction)/noise of the
    same shape, so that its real and imaginary parts have unit variance where the model holds. Both
    are NaN where nothing was measured.
    """

    fit: Fit
    prediction: dict[str, NDArray[np.complex128]]
    residual: dict[str, NDArray[np.complex128]]

    def __repr__(self) -> str:
        """The fit, and how many maps."""
        return f"<MapFit of {len(self.prediction)} maps: {self.fit!r}>"

    def plot(self, data: "xr.Dataset", name: str = "") -> "Figure":
        """Draw one map: measured, fitted, and the residual in both quadratures.

        Args: data: the map that was fitted, of kind `map`; name: what the fit calls it, "" for a
            single one.
        Raises: ParameterError for a name that the fit does not know.
        """
        if name not in self.prediction:
            known = ", ".join(repr(other) for other in self.prediction)
            raise ParameterError(f"name = {name!r}: the fit has the maps {known}")
        draw = function("femnl.plot.mapfit:map_fit_figure")
        figure: Figure = draw(data, self.prediction[name], self.residual[name])
        return figure

    def _tables(self) -> list[Table]:
        return self.fit._tables()


@dataclass(frozen=True)
class MotionFit(Tabulated):
    """A fit of the harmonics at one spot over the steps of a drive.

    One fringe, and the motion at each step.

    fit: the fringe's parameters. amplitude [m], phase [rad] of the motion at each step and their
    standard deviations (n_steps,);
    prediction: V_n [V], complex (n_harmonics, n_steps); residual: (data − prediction)/sd of the
    same shape.
    """

    fit: Fit
    amplitude: NDArray[np.float64]
    amplitude_sd: NDArray[np.float64]
    phase: NDArray[np.float64]
    phase_sd: NDArray[np.float64]
    prediction: NDArray[np.complex128]
    residual: NDArray[np.complex128]

    def __post_init__(self) -> None:
        freeze(self)

    def __repr__(self) -> str:
        """The fit, and how many steps."""
        return f"<MotionFit of {len(self.amplitude)} steps: {self.fit!r}>"

    def plot(self, data: "HarmonicSpectrum") -> "Figure":
        """Draw the harmonics over the steps, and the amplitude of motion.

        Args: data: the harmonics that were fitted.
        """
        figure: Figure = function("femnl.plot.harmonics:harmonics_figure")(data, self)
        return figure

    def to_dataset(self) -> "xr.Dataset":
        """Return the motion over `step` (from 1), SI units as attributes."""
        return dataset(
            "step",
            {"step": (np.arange(1, len(self.amplitude) + 1), "")},
            {
                "amplitude": (self.amplitude, "m"),
                "amplitude_sd": (self.amplitude_sd, "m"),
                "phase": (self.phase, "rad"),
                "phase_sd": (self.phase_sd, "rad"),
            },
        )

    def to_dataframe(self) -> "pd.DataFrame":
        """Return a row a step (from 1), in SI; `attrs["units"]` holds the units by column."""
        return dataframe(self.to_dataset())

    def _tables(self) -> list[Table]:
        columns = {
            "step": [str(k + 1) for k in range(len(self.amplitude))],
            "amplitude (nm)": measured(self.amplitude * 1e9, self.amplitude_sd * 1e9),
            "phase (rad)": measured(self.phase, self.phase_sd),
        }
        return [*self.fit._tables(), Table("Motion at each step of the drive", columns)]
