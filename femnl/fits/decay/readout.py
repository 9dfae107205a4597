"""How a readout wanders: its noise from the data themselves, beside smooth bends and beats."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.optimize import minimize

from femnl.fits.decay.periods import at_cycles
from femnl.observe.decay.blocks import Blocks, Wander, read

Array = NDArray[np.float64]
BENDS = 9
"""Polynomials that are taken off: a cause bends a decay, and that is no noise."""
FEWEST_BEAT_POINTS = 24
"""Points of a decay that can show beats: bends and waves make up fewer of noise."""
FEWEST_BEATS = 2.5
FEW_BENDS = 4
"""Periods from which on beats are told from a bend, and polynomials that are taken for one."""
BEAT_SHARE = 0.6
"""Part of what is left from which on one period is beats, and no noise."""
LEAST = 7e-4
"""ln of the power by which an analyser reproduces a reading: 0.003 dB."""
LARGEST = 1.0
"""ln of the power by which a readout wanders at most."""
IMPOSSIBLE = 1e9
"""−ln of the likelihood of a noise that no data can have."""
OFF = 4.0
"""Factor by which the filter's noise may differ from what the floor of a fit says."""
FEWEST = 24
"""Blocks above the floor from which on noise is told from bends."""
MEMORY = 1 / 20
"""Memory that a search starts from, in parts of the duration."""
THOROUGH = 400
ROUGH = 40
"""Steps of a search, and of one that only ranks filters."""
STEP = 0.7
"""First steps of a search, in the logarithm."""
LONGEST = 0.5
"""Longest memory, in parts of the duration: what is slower is a bend."""


@dataclass(frozen=True, eq=False)
class Noisy:
    """Data whose noise is asked for.

    blocks: of the data. values (n,): what fluctuates. filtered (n, n): covariance of that by the
    filter's noise. share (n,): by which noise of the readout counts. late (n,): data of the floor,
    which has one mean.
    """

    blocks: Blocks
    values: Array
    filtered: Array
    share: Array
    late: NDArray[np.bool_]


def wander_of(data: Noisy, most: int = THOROUGH) -> tuple[Wander, float]:
    """Return the noise of the readout that makes the data likeliest, and −ln of how likely.

    Whatever bends them. most: steps of the search.

    By restricted likelihood, which counts what polynomials and beats take up.
    Source: Patterson and Thompson, Biometrika 58, 545 (1971).
    """
    early = ~data.late
    time = data.blocks.time[early]
    values = data.values[early]
    duration = float(np.ptp(time))
    interval = data.blocks.width / float(np.max(data.blocks.count))
    if len(time) < FEWEST:
        left = values - np.polyval(np.polyfit(time, values, 2), time)
        scatter = float(np.sqrt(np.sum(left**2) / (len(time) - 3)))
        white = scatter * float(np.sqrt(data.blocks.count.max()))
        return Wander(1.0, max(white, LEAST), LEAST, interval), 0.0
    bends = _design(time, values)
    design = np.zeros((len(data.values), bends.shape[1] + 1))
    design[early, :-1] = bends
    design[data.late, -1] = 1.0
    design = design if data.late.any() else design[:, :-1]
    low = np.log([1 / OFF, LEAST, LEAST, data.blocks.width])
    high = np.log([OFF, LARGEST, LARGEST, LONGEST * duration])
    cost = _cost(data, design)

    def objective(logs: Array) -> float:
        inside = np.clip(logs, low, high)
        return cost(Wander(*np.exp(inside))) + float(np.sum((logs - inside) ** 2))

    left = values - bends @ np.linalg.lstsq(bends, values, rcond=None)[0]
    # Half of the data scatter less: those far above the noise of the filter, which show the readout
    scatter = np.log(max(float(np.median(np.abs(left))), 2 * LEAST))
    start = np.clip([0.0, scatter, scatter, np.log(MEMORY * duration)], low, high)
    simplex = start + np.vstack([np.zeros(4), STEP * np.eye(4)])
    best = minimize(
        objective,
        start,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 0.02, "fatol": 0.01, "maxiter": most},
    )
    return Wander(*np.exp(np.clip(best.x, low, high))), float(best.fun)


def _cost(data: Noisy, design: Array) -> Callable[[Wander], float]:
    """Return −ln of the restricted likelihood as a function of the noise."""

    def cost(wander: Wander) -> float:
        matrix = wander.filtered * data.filtered + read(data.blocks, data.share, wander)
        try:
            factor = cho_factor(matrix, lower=True)
        except LinAlgError:
            return IMPOSSIBLE
        solved = cho_solve(factor, np.column_stack([design, data.values]))
        across = design.T @ solved[:, :-1]
        beside = design.T @ solved[:, -1]
        square = data.values @ solved[:, -1] - beside @ np.linalg.solve(across, beside)
        volume = 2 * float(np.sum(np.log(np.diag(factor[0]))))
        return 0.5 * (volume + float(np.linalg.slogdet(across)[1]) + float(square))

    return cost


def _design(time: Array, values: Array) -> Array:
    """Return polynomials (n, k), and one period with its overtone where the data beat."""
    place = 2 * (time - time[0]) / np.ptp(time) - 1
    bends = np.polynomial.legendre.legvander(place, BENDS - 1)
    left = values - bends @ np.linalg.lstsq(bends, values, rcond=None)[0]
    waves = _waves(place, left, BENDS / 2)
    with_beats = np.column_stack([bends, waves])
    return with_beats if _take_up(with_beats, left) else bends


def beats(time: Array, values: Array, least: float, fewest: float = FEWEST_BEATS) -> bool:
    """Whether values (n,) at times (n,) are a bend, and for the rest one period for the most part.

    Never where the values are too few to tell.
    Args: least: rms of the rest from which on it counts; fewest: periods.
    """
    if len(time) < FEWEST_BEAT_POINTS:
        return False
    place = 2 * (time - time[0]) / np.ptp(time) - 1
    bend = np.polynomial.legendre.legvander(place, FEW_BENDS - 1)
    left = values - bend @ np.linalg.lstsq(bend, values, rcond=None)[0]
    waves = _waves(place, left, fewest)
    # A corner is made up of waves as well, but not on either side of it
    halves = np.array_split(np.arange(len(left)), 2)
    rest = left - waves @ np.linalg.lstsq(waves, left, rcond=None)[0]
    share = [np.sum(rest[half] ** 2) / np.sum(left[half] ** 2) for half in halves]
    return float(np.std(left)) > least and max(share) < 1 - BEAT_SHARE


def _take_up(columns: Array, left: Array) -> bool:
    """Whether columns (n, k) take up most of what is left (n,)."""
    rest = left - columns @ np.linalg.lstsq(columns, left, rcond=None)[0]
    return float(np.sum(rest**2)) < (1 - BEAT_SHARE) * float(np.sum(left**2))


def _waves(place: Array, left: Array, fewest: float) -> Array:
    """Return the strongest period (n, k) of what is left, its overtone, and how both change."""
    cycles = np.arange(fewest, len(place) / 3, 0.25)
    power = np.abs(at_cycles(place - place[0], left, cycles)) ** 2
    best = float(cycles[np.argmax(power)])
    waves = [
        wave(np.pi * order * best * place) * place**n
        for order, powers in ((1, 3), (2, 2))
        for n in range(powers)
        for wave in (np.cos, np.sin)
    ]
    return np.column_stack(waves)
