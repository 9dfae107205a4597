"""Blocks of a record that are compared with a model, and the noise of their mean power.

The noise has two parts: that of the filter, whose size follows from S/N, and that of the readout,
which multiplies the signal, with a white part and one that wanders and forgets where it was, a
process of Ornstein and Uhlenbeck.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

Array = NDArray[np.float64]
Index = NDArray[np.intp]
STRAIGHT = 100.0
"""S/N from which on the scale is more and more the logarithm."""
FORGOTTEN = 1e-5
"""Correlation below which two points count as independent."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """Points (n,) of a record in blocks of neighbours.

    first (n_blocks,): the first point of each; count (n_blocks,): of its points; time (n_blocks,)
    [s]: their mean, from the begin of the decay; width [s]: of a whole block.
    """

    first: Index
    count: Array
    time: Array
    width: float

    def mean(self, values: Array) -> Array:
        """Return the means (n_blocks,) of values (n,)."""
        return np.asarray(np.add.reduceat(values, self.first) / self.count)


def in_blocks(time: Array, number: Index, width: float) -> Blocks:
    """Return blocks of points (n,) of equal number, which is that of their block."""
    first = np.flatnonzero(np.diff(number, prepend=-1))
    count = np.diff(np.append(first, len(time))).astype(float)
    return Blocks(first, count, np.add.reduceat(time, first) / count, width)


def part_of(blocks: Blocks, chosen: NDArray[np.bool_]) -> Blocks:
    """Return some of the blocks."""
    return Blocks(blocks.first[chosen], blocks.count[chosen], blocks.time[chosen], blocks.width)


@dataclass(frozen=True)
class Wander:
    """Noise of the readout, in ln of the power, beside that of the filter.

    filtered: noise of the filter over what S/N says, as a ratio of variances. white: standard
    deviation of one point. size: that of the part that wanders; memory [s]: the time after which it
    has forgotten where it was.
    """

    filtered: float
    white: float
    size: float
    memory: float


@dataclass(frozen=True)
class Filter:
    """The filter of an analyser, as its noise shows it.

    Amplitudes behind it are correlated as e^{−|t/memory|^steepness}, memory in s: steepness 1 of a
    single pole, 2 of a Gaussian filter. averages: independent values that each power is the mean
    of.
    """

    memory: float
    steepness: float
    averages: float


def filtered(blocks: Blocks, time: Array, share: Array, behind: Filter) -> Array:
    """Return the relative covariance (n_blocks, n_blocks) of mean powers by a filter's noise.

    Of p = |a + n|² with S = |a|² and N = ⟨|n|²⟩, n complex normal with a correlation ρ, it is
    (2SNρ + N²ρ²)/(S + N)².

    Args:
        blocks: of points.
        time: of the points (n,) [s].
        share: S/(S + N) (n_blocks,).
        behind: the filter.
    """
    mixed = np.sqrt(2 * share * (1 - share) / behind.averages)
    alone = (1 - share) / np.sqrt(behind.averages)
    number = np.repeat(np.arange(len(blocks.first)), blocks.count.astype(int))
    size = len(blocks.first)
    once = np.diag(0.5 * blocks.count)
    twice = once.copy()
    for lag in range(1, len(time)):
        rho = np.exp(-(((time[lag:] - time[:-lag]) / behind.memory) ** behind.steepness))
        if rho.max() < FORGOTTEN:
            break
        pair = number[:-lag] * size + number[lag:]
        once += np.bincount(pair, rho, size**2).reshape(size, size)
        twice += np.bincount(pair, rho**2, size**2).reshape(size, size)
    found = (once + once.T) * np.outer(mixed, mixed) + (twice + twice.T) * np.outer(alone, alone)
    return np.asarray(found / np.outer(blocks.count, blocks.count))


def read(blocks: Blocks, share: Array, wander: Wander) -> Array:
    """Return the covariance (n_blocks, n_blocks) of ln of the mean power by the readout's noise.

    Args: share (n_blocks,): S/(S + N), by which it counts.
    """
    apart = np.abs(blocks.time[:, None] - blocks.time[None, :])
    found = wander.size**2 * np.exp(-apart / wander.memory)
    found = found + np.diag(wander.white**2 / blocks.count)
    return np.asarray(found * np.outer(share, share))


def drifting(blocks: Blocks, share: Array, size: float, memory: float) -> Array:
    """Return the covariance (n_blocks, n_blocks) by a gain that drifts smoothly.

    Args: share (n_blocks,): S/(S + N); size: standard deviation in ln of the power; memory [s]: of
    a correlation e^{−(t/memory)²/2}.
    """
    apart = (blocks.time[:, None] - blocks.time[None, :]) / memory
    return np.asarray(size**2 * np.exp(-(apart**2) / 2) * np.outer(share, share))


@dataclass(frozen=True, eq=False)
class Whitening:
    """A lower triangular factor (n, n) of a covariance, which turns noise white and back."""

    factor: Array

    def white(self, away: Array) -> Array:
        """Return deviations (…, n) as independent ones of variance 1."""
        return np.asarray(solve_triangular(self.factor, away.T, lower=True).T)

    def coloured(self, white: Array) -> Array:
        """Return what `white` came from."""
        return np.asarray(white @ self.factor.T)

    @property
    def sd(self) -> Array:
        """Standard deviation (n,) of each datum."""
        return np.asarray(np.sqrt(np.sum(self.factor**2, axis=1)))


@dataclass(frozen=True, eq=False)
class Scale:
    """A scale on which mean powers of blocks (n,) have normal noise: (q^λ − 1)/λ, q = p/reference.

    For noise alone λ is 1/3, as the cube root of a χ² is nearly normal even for two degrees of
    freedom; with signal it comes near 1/2. Far above the noise any scale is normal, and λ goes to
    0: in ln p a decay is straight, which helps a fit that starts far off.

    reference (n,): ln of a power near each; exponent λ (n,); variance (n,) of each power, in parts
    of its square.
    Source: Sankaran, Biometrika 46, 235 (1959).
    """

    reference: Array
    exponent: Array
    variance: Array

    def data(self, log_power: Array) -> Array:
        """Return powers (n,) as measured, from their ln."""
        away = log_power - self.reference
        return np.asarray(np.expm1(self.exponent * away) / self.exponent)

    def expected(self, log_power: Array) -> Array:
        """Return the mean on this scale of powers with a mean (n,), from its ln."""
        away = log_power - self.reference
        # To second order in the noise, ⟨q^λ⟩ = ⟨q⟩^λ (1 + λ(λ − 1)/2 · var)
        bent = 0.5 * (self.exponent - 1) * self.variance * np.exp(self.exponent * away)
        return np.asarray(np.expm1(self.exponent * away) / self.exponent + bent)


def normal_scale(reference: Array, ratio: Array, variance: Array) -> Scale:
    """Return the scale of powers near ln references (n,), whose S/N is a ratio (n,)."""
    normal = 1 - 2 / 3 * (1 + ratio) * (1 + 3 * ratio) / (1 + 2 * ratio) ** 2
    return Scale(reference, normal / (1 + ratio / STRAIGHT), variance)
