"""Results of fits: parameters in SI with standard deviations, and how well the data are met."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.core.arrays import freeze


@dataclass(frozen=True)
class Parameter:
    """One fitted number in `unit`.

    value, and standard deviation sd (68 % where normal; inf where the data say nothing).
    """

    name: str
    value: float
    sd: float
    unit: str


@dataclass(frozen=True)
class Fit:
    """The outcome of a least-squares fit.

    parameters: by name, the free ones first and in the order of `covariance`, then derived ones.
    covariance (n_parameters, n_parameters) in SI. chi2_reduced = χ²/(n_points − n_parameters),
    n_points counting real numbers.
    notes: sentences for the report: what was assumed, estimated, left out, or cannot be told from
    these data.
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


@dataclass(frozen=True)
class MapFit:
    """A fit of harmonic maps, and by name of the map what it predicts and what it leaves.

    prediction: V_n [V], complex (n_harmonics, n_y, n_x); residual: (data − prediction)/noise of the
    same shape, so that its real and imaginary parts have unit variance where the model holds. Both
    are NaN where nothing was measured.
    """

    fit: Fit
    prediction: dict[str, NDArray[np.complex128]]
    residual: dict[str, NDArray[np.complex128]]


@dataclass(frozen=True)
class MotionFit:
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
