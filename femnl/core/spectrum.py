"""Lines found in a wide sweep, and which simulated mode each of them is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.core.arrays import freeze
from femnl.core.fit import Fit

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Peaks:
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


@dataclass(frozen=True)
class Labelling:
    """One way to give peaks to modes.

    Mode of each peak (None for a spurious one) and its posterior probability.
    """

    mode: tuple[int | None, ...]
    label: tuple[str | None, ...]
    probability: float


@dataclass(frozen=True)
class Assignment:
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


@dataclass(frozen=True)
class FilmFit:
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
