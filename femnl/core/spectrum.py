"""Lines found in a wide sweep, and which simulated mode each of them is."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from femnl.core.arrays import freeze
from femnl.core.fit import Fit
from femnl.core.kinds import function
from femnl.core.numbers import measured, plain
from femnl.core.tables import Table, Tabulated, dataframe, dataset

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Peaks(Tabulated):
    """Resonances of a wide sweep by rising frequency.

    V(f) = Σ_k A_k f_kγ_k/(f_k² − f² + i f γ_k) on a smooth background.

    frequency f_k and linewidth γ_k = f_k/Q_k [Hz] with their sd (inf where the points do not tell);
    amplitude A_k [V], complex, |A_k| the height of the line, with amplitude_sd per quadrature; all
    arrays (n_peaks,). prediction [V], lines and background, at `points` [Hz]; band [Hz]: the range
    that was swept. chi2_reduced: of the points near lines; notes: sentences for the report.
    """

    frequency: Array
    frequency_sd: Array
    linewidth: Array
    linewidth_sd: Array
    amplitude: NDArray[np.complex128]
    amplitude_sd: Array
    points: Array
    prediction: NDArray[np.complex128]
    band: tuple[float, float]
    chi2_reduced: float
    notes: tuple[str, ...]

    def __post_init__(self) -> None:
        freeze(self)

    @property
    def quality_factor(self) -> Array:
        """Q = f/γ."""
        return np.asarray(self.frequency / self.linewidth)

    @property
    def quality_factor_sd(self) -> Array:
        """Standard deviation of Q, that of the linewidth alone."""
        return np.asarray(self.quality_factor * self.linewidth_sd / self.linewidth)

    def __repr__(self) -> str:
        """Number of lines, and the range that was swept."""
        low, high = self.band
        return f"<Peaks: {len(self.frequency)} lines from {low:.7g} Hz to {high:.7g} Hz>"

    def plot(self, data: "xr.Dataset", sweep: int = 0) -> "Figure":
        """Draw the lines in the sweep that they were found in.

        Args: data: of kind `response`; sweep: which of its sweeps, from 0.
        """
        draw = function("femnl.plot.overview:overview_figure")
        figure: Figure = draw(data, self, sweep=sweep)
        return figure

    def to_dataset(self) -> "xr.Dataset":
        """Return the lines over `peak` (from 1), SI units as attributes; real and imag are of A."""
        return dataset(
            "peak",
            {"peak": (np.arange(1, len(self.frequency) + 1), "")},
            {
                "frequency": (self.frequency, "Hz"),
                "frequency_sd": (self.frequency_sd, "Hz"),
                "linewidth": (self.linewidth, "Hz"),
                "linewidth_sd": (self.linewidth_sd, "Hz"),
                "quality_factor": (self.quality_factor, "1"),
                "quality_factor_sd": (self.quality_factor_sd, "1"),
                "real": (self.amplitude.real, "V"),
                "imag": (self.amplitude.imag, "V"),
                "amplitude_sd": (self.amplitude_sd, "V"),
            },
        )

    def to_dataframe(self) -> "pd.DataFrame":
        """Return a row a line (from 1), in SI; `attrs["units"]` holds the units by column."""
        return dataframe(self.to_dataset())

    def _tables(self) -> list[Table]:
        columns = {
            "line": [str(k + 1) for k in range(len(self.frequency))],
            "f (Hz)": measured(self.frequency, self.frequency_sd),
            "f/Q (Hz)": measured(self.linewidth, self.linewidth_sd),
            "Q": measured(self.quality_factor, self.quality_factor_sd),
            "|A| (V)": measured(np.abs(self.amplitude), self.amplitude_sd),
        }
        title = f"{len(self.frequency)} lines, χ²/ν = {self.chi2_reduced:.4g}"
        return [Table(title, columns, self.notes)]


@dataclass(frozen=True)
class Labelling:
    """One way to give peaks to modes.

    Mode of each peak (None for a spurious one) and its posterior probability.
    """

    mode: tuple[int | None, ...]
    label: tuple[str | None, ...]
    probability: float


@dataclass(frozen=True)
class Assignment(Tabulated):
    """Which simulated mode each measured peak is.

    deviation: f/(c g) − 1 of each peak from its mode at the common scale, NaN for a spurious one.
    best and runner_up (None where nothing else has a chance); scale: measured over simulated
    frequency, with its sd;
    model_sd: relative scatter of the simulation about the peaks, as the data show it; missing:
    labels of the modes inside the swept band that no peak was given to; ambiguous: groups of labels
    that frequencies alone cannot tell apart;
    up_to_ambiguous: probability of the best labelling where labels of one such group count as one.
    """

    best: Labelling
    runner_up: Labelling | None
    scale: float
    scale_sd: float
    model_sd: float
    missing: tuple[str, ...]
    ambiguous: tuple[tuple[str, ...], ...]
    up_to_ambiguous: float
    deviation: Array

    def __post_init__(self) -> None:
        freeze(self)

    def __repr__(self) -> str:
        """Number of lines, and the probability of the best labelling."""
        return (
            f"<Assignment of {len(self.deviation)} lines, probability {self.best.probability:.3g}>"
        )

    def to_dataframe(self) -> "pd.DataFrame":
        """Return a row a line (from 1): label, that of the runner-up ("" without) and deviation."""
        rival = self.best if self.runner_up is None else self.runner_up
        return dataframe(
            dataset(
                "peak",
                {"peak": (np.arange(1, len(self.deviation) + 1), "")},
                {
                    "label": ([label or "" for label in self.best.label], ""),
                    "runner_up": ([label or "" for label in rival.label], ""),
                    "deviation": (self.deviation, "1"),
                },
            )
        )

    def _tables(self) -> list[Table]:
        columns = {
            "line": [str(k + 1) for k in range(len(self.deviation))],
            "mode": [label or "none" for label in self.best.label],
            "away (ppm)": _ppm(self.deviation),
        }
        title = f"Modes of {len(self.deviation)} lines, probability {self.best.probability:.3g}"
        (scale,) = measured([self.scale], [self.scale_sd])
        notes = [f"measured over simulated frequency: {scale}"]
        if self.runner_up is not None:
            others = ", ".join(label or "none" for label in self.runner_up.label)
            notes.append(f"runner-up, probability {self.runner_up.probability:.2g}: {others}")
        if self.missing:
            notes.append(f"modes of this range without a line: {', '.join(self.missing)}")
        hardly = "frequencies alone hardly separate"
        notes += [f"{hardly} {', '.join(group)}" for group in self.ambiguous]
        return [Table(title, columns, notes)]


@dataclass(frozen=True)
class FilmFit(Tabulated):
    """A measured spectrum beside the simulated one.

    One scale for all modes, and how far each lies from it.

    fit: `scale` c/c_sim, `wave_speed` c [m/s], `stress` [Pa] of the film before release, `scatter`
    of the modes about the scale. label, frequency, frequency_sd, simulated [Hz], deviation f/(c g)
    − 1, all (n,) by rising frequency; assignment: how lines without a label were given to modes,
    None where the file names them.
    """

    fit: Fit
    label: tuple[str, ...]
    frequency: Array
    frequency_sd: Array
    simulated: Array
    deviation: Array
    assignment: Assignment | None

    def __post_init__(self) -> None:
        freeze(self)

    def __repr__(self) -> str:
        """The fit, and how many modes."""
        return f"<FilmFit of {len(self.label)} modes: {self.fit!r}>"

    def plot(self) -> "Figure":
        """Draw how far each line lies from its simulated mode at the common scale."""
        figure: Figure = function("femnl.plot.overview:film_figure")(self)
        return figure

    def to_dataset(self) -> "xr.Dataset":
        """Return measured and simulated frequencies over `mode` (from 1).

        Returns: Dataset with SI units as attributes; `simulated` is before the common scale.
        """
        return dataset(
            "mode",
            {
                "mode": (np.arange(1, len(self.label) + 1), ""),
                "label": (list(self.label), ""),
            },
            {
                "frequency": (self.frequency, "Hz"),
                "frequency_sd": (self.frequency_sd, "Hz"),
                "simulated": (self.simulated, "Hz"),
                "deviation": (self.deviation, "1"),
            },
        )

    def to_dataframe(self) -> "pd.DataFrame":
        """Return a row a mode (from 1), in SI; `attrs["units"]` holds the units by column."""
        return dataframe(self.to_dataset())

    def _tables(self) -> list[Table]:
        scaled = self.simulated * self.fit["scale"]
        columns = {
            "mode": self.label,
            "f (Hz)": measured(self.frequency, self.frequency_sd),
            "simulated, scaled (Hz)": [plain(f, 9) for f in scaled],
            "away (ppm)": _ppm(self.deviation),
        }
        found = [*self.fit._tables(), Table("Lines beside the simulation", columns)]
        return found if self.assignment is None else [*found, *self.assignment._tables()]


def _ppm(shares: Array) -> list[str]:
    return ["–" if np.isnan(share) else f"{share * 1e6:.1f}" for share in shares]
