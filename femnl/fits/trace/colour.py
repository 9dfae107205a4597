"""The colour of the noise of traces: how strong it is at each frequency."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter

from femnl.core.readout import Array

AROUND = 7
"""Samples of about one phase, with which one of them is compared."""
HIGHEST_ORDER = 6
"""Samples before that noise may follow: low passes of a detector and its filters have few poles."""
ROUNDS = 3
"""Times that the colour is found, with what was taken of the noise as the one before tells."""
ROUNDING = 1e-15  # of what drives noise that its past tells wholly, as that of a tone
NARROWEST = 4.0
"""Half width of a peak of noise, in steps of a record's spectrum, below which it is a line."""
LINE = 1e-3
"""Probability of a peak in the spectrum of white noise, below which it is a line."""
GRID = 4096
"""Frequencies at which the power of noise is averaged."""


@dataclass(frozen=True)
class Colour:
    """Autoregressive noise x_k = Σ_j a_j x_{k−j} + w_k, with w white.

    following (p,): a; empty for white noise.
    """

    following: Array

    def relative_power(self, cycles: Array) -> Array:
        """Return the power density at some frequencies over its mean.

        It is |1 − Σ_j a_j e^{−2πijc}|⁻² over the mean of that.

        Args: cycles: frequencies in cycles a sample.
        """
        return np.asarray(self._power(cycles) / self._power(self._grid).mean())

    @property
    def correlation_length(self) -> float:
        """How many neighbouring samples count as one for a mean: S(0)/⟨S⟩."""
        return float(self.relative_power(np.zeros(1))[0])

    @property
    def independent(self) -> float:
        """Part of the samples that count as independent for their variance: ⟨S⟩²/⟨S²⟩."""
        power = self._power(self._grid)
        return float(power.mean() ** 2 / np.mean(power**2))

    @property
    def narrowest(self) -> float:
        """Half width of the narrowest peak of the power, in cycles a sample; ∞ for white noise."""
        poles = np.roots(np.concatenate([[1.0], -self.following]))
        nearest = float(np.max(np.abs(poles), initial=0.0))  # to the unit circle
        return -np.log(nearest) / (2 * np.pi) if nearest else np.inf

    @property
    def _grid(self) -> Array:
        return (np.arange(GRID) + 0.5) / (2 * GRID)

    def _power(self, cycles: Array) -> Array:
        lags = np.arange(1, len(self.following) + 1)
        turned = np.exp(-2j * np.pi * np.multiply.outer(cycles, lags))
        return np.asarray(np.abs(1 - turned @ self.following) ** -2)


WHITE = Colour(np.empty(0))


def noise_colour(left: Array, taken: Array | None = None) -> Colour | None:
    """Return the colour of what is left of traces, white where no other is clear.

    The order is the one of least −2 ln L + p ln N. None where a line is left, as of a tone that
    beats in the records, or of a drift: in the white part w, or as a peak of the colour that is too
    narrow for these records.

    Args: left (n_steps, n_samples) [V]: at equal intervals, NaN where a sample is missing. taken:
        frequencies in cycles a sample of sines that least squares took out of each row, and of the
        noise with them, beside its mean.
    Source: Yule–Walker equations; R. A. Fisher, Proc. R. Soc. A 125, 54 (1929), for lines.
    """
    count = int(np.isfinite(left).sum())
    known = np.nan_to_num(left)
    lags = range(min(HIGHEST_ORDER + 1, left.shape[1]))
    seen = np.array([np.sum(known[:, k:] * known[:, : left.shape[1] - k]) for k in lags])
    if not seen[0] > 0:
        return WHITE
    best = WHITE
    for _ in range(1 if taken is None else ROUNDS):
        covariance = seen if taken is None else seen + _taken(best, taken, seen[0], left.shape)
        fits = [Colour(_following(covariance, p)) for p in lags]
        driving = [
            1 - fit.following @ covariance[1 : p + 1] / covariance[0] for p, fit in enumerate(fits)
        ]
        cost = count * np.log(np.maximum(driving, ROUNDING)) + np.log(count) * np.arange(len(fits))
        best = fits[int(np.argmin(cost))]
        if best.narrowest < NARROWEST / left.shape[1]:
            return None
    white = lfilter(np.concatenate([[1.0], -best.following]), [1.0], known, axis=-1)
    return None if _has_line(white) else best


def _taken(colour: Colour, taken: Array, power: float, shape: tuple[int, ...]) -> Array:
    """Return what sines and means took of the covariances (n_lags,) of noise of some colour.

    Each took S(c) cos 2πck, twice for a sine.

    Args: power: what they left of the squares of all rows. shape: (n_steps, n_samples).
    """
    steps, samples = shape
    cycles = np.concatenate([[0.0], taken])
    part = np.concatenate([[1.0], np.full(len(taken), 2.0)]) * colour.relative_power(cycles)
    variance = power / (steps * (samples - part.sum()))
    lags = np.arange(min(HIGHEST_ORDER + 1, samples))
    return np.asarray(steps * variance * (part @ np.cos(2 * np.pi * np.outer(cycles, lags))))


def _following(covariance: Array, order: int) -> Array:
    """Return the coefficients (order,) of the noise of these covariances, by lag from 0."""
    if not order:
        return np.empty(0)
    return np.asarray(solve_toeplitz(covariance[:order], covariance[1 : order + 1]))


def _has_line(white: Array) -> bool:
    """Whether the spectrum of a row (n_steps, n_samples) has a peak that white noise has not."""
    power = np.abs(np.fft.rfft(white, axis=-1)[:, 1:-1]) ** 2
    highest = power.max() / power.mean()
    return bool(power.size * np.exp(-highest) < LINE)


def beside_phase(left: Array, order: NDArray[np.intp], middle: Callable[..., Array]) -> Array:
    """Return residuals (n,) less what recurs in each period: what harmonics beyond the last leave.

    A clipped signal leaves much at its corners.

    Args: order: the samples that are there, by their phase. middle: of the samples around one, a
        mean, which keeps the colour of noise, or a median, which no glitch moves.
    """
    half = AROUND // 2
    around = sliding_window_view(np.pad(left[order], half, mode="wrap"), AROUND)
    found = left.copy()
    # Without the sample itself: it would be the median of one record in so many
    found[order] -= middle(np.delete(around, half, axis=1), axis=1)
    return found
