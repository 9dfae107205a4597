"""Whether what a fit of a ring-down leaves is noise, or more near the mode than beside it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MISSED = 4.0
"""Power near the mode over that beside it from which on a model misses the data."""
HOPELESS = 25.0
"""The same, from which on no scale makes errors honest."""
FEWEST = 16
"""Least steps of the spectrum that are near the mode."""
WIDTHS = 5.0
"""Linewidths that are near the mode."""
SIDES = 3
"""How many times as far as what is near the mode reaches what is beside it."""
MEDIAN = float(np.log(2))
"""Median over mean of the powers of a noise's spectrum, which are exponential."""


@dataclass(frozen=True)
class ResidualPower:
    """Power of the residuals of a fit, in units of the noise that is assumed.

    near, beside, floor: power near the mode, in most of the spectrum beside it, and in most of the
    rest, each 1 for the white noise assumed. within: how far from the mode is near [Hz].
    stated: whether the noise is known beforehand.
    """

    near: float
    beside: float
    floor: float
    within: float
    stated: bool

    @property
    def ratio(self) -> float:
        """Power near the mode over that beside it."""
        return self.near / self.beside

    @property
    def misses(self) -> bool:
        """Whether the model misses the data."""
        return self.ratio > MISSED and (self.near > MISSED or not self.stated)

    @property
    def factor(self) -> float:
        """Return what makes standard deviations honest; NaN where nothing does."""
        if not self.misses:
            return 1.0
        return float(np.sqrt(self.near)) if self.ratio < HOPELESS else np.nan

    @property
    def note(self) -> str:
        """What a report says of a model that misses the data."""
        told = (
            f"the model misses the data: what is left within {self.within:.3g} Hz of the mode has "
            f"{self.ratio:.3g} times the power of what is left beside it"
        )
        if np.isnan(self.factor):
            return f"{told}; no standard deviations are given"
        return f"{told}; standard deviations are those of it"


def residual_power(
    rest: NDArray[np.inexact], interval: float, frequency: float, width: float, *, stated: bool
) -> ResidualPower:
    """Return the power of residuals near a mode and beside it.

    Args: rest (n,): in units of the noise, real of a voltage or of a squared magnitude, complex of
        an amplitude, whose parts have unit variance each; interval between samples [s]; frequency:
        of the mode in the spectrum of the residuals [Hz]; width: the mode's linewidth [Hz]; stated:
        whether the noise is known beforehand.
    """
    n = len(rest)
    parts = 2 if np.iscomplexobj(rest) else 1
    power = np.abs(np.fft.fft(rest)) ** 2 / (n * parts)
    step = 1 / (n * interval)
    reach = int(np.clip(np.ceil(WIDTHS * width / step), FEWEST, max(n // (4 * SIDES), 1)))
    # A frequency beyond half the rate is seen folded
    away = np.abs((np.arange(n) - frequency / step + n / 2) % n - n / 2)
    sides = (away > reach) & (away <= SIDES * reach)
    near = float(power[away <= reach].mean())
    # A line of its own, such as another mode, hardly moves the median
    wider = float(power[sides].mean())
    beside, floor = (float(np.median(power[some])) / MEDIAN for some in (sides, away > reach))
    within = reach if near >= wider else SIDES * reach
    return ResidualPower(max(near, wider), beside, floor, within * step, stated)
