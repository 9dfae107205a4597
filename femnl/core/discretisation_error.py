"""Discretisation errors, from how a number settles through three degrees of the same mesh."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SAFETY = 5.0  # on the remainder that steady convergence would leave
# Of the usual difference, and of the usual pace, which each number is taken to have at least: one
# alone may vanish by chance
SHARE = 0.43
MOST = 3.0  # of the last difference, where three degrees do not show that they converge
# Of the errors of two frequencies, which their ratio keeps where the two seem to err alike
UNLIKE = 0.03
ERRORS = "±: discretisation errors, upper estimates"
NO_ERRORS = "errors are not known: the modes carry no counterpart of lower degree"
ROUNDING = 1e-11  # relative, of coordinates and of solutions


def remainder(
    values: Sequence[Array], scale: Array, least: float | Array, safety: float = SAFETY
) -> Array:
    """Return the error of the finest of three (or two) approximations.

    |Q₄ − Q₃| times what |Q₄ − Q₃| is of |Q₃ − Q₂|, times a safety.

    Args: values: fine, coarse and coarsest, each of one shape; NaN where an approximation is
        missing. scale: their natural size. least: of the last difference, what is taken to be left
        however fast it fell.
    Returns: absolute errors, infinite where there is nothing to compare with; two approximations do
    not show that they converge.
    Source: geometric convergence in the degree; held against references by
    tests/physics/test_error_bars.py.
    """
    left = settle(*steps(values, scale), safety, least)
    return np.asarray(np.where(np.isnan(left), np.inf, left + ROUNDING) * np.abs(scale))


def steps(values: Sequence[Array], scale: Array) -> tuple[Array, Array]:
    """Return the relative differences of the finest to the next and of that to the coarsest.

    NaN where there is none.
    """
    fine, coarse, *more = (value / scale for value in values)
    return np.abs(fine - coarse), np.abs(coarse - more[0]) if more else np.full(fine.shape, np.nan)


def settle(last: Array, before: Array, safety: float, least: float | Array) -> Array:
    """Return what is left after relative differences `last` that followed on `before`.

    `safety` times what steady convergence leaves.
    """
    return np.asarray(
        share_left(last, before, safety, least) * np.maximum(last, SHARE * _rms_of_finite(last))
    )


def share_left(last: Array, before: Array, safety: float, least: float | Array) -> Array:
    """Return the part of the last differences that is left, between `least` and `MOST`.

    `MOST` stands where there are none `before` them.

    The pace is the geometric mean of a number's own and of what is usual among all: each alone is
    off by chance, either way.
    """
    common = (
        min(_rms_of_finite(last) / _rms_of_finite(before), 1.0)
        if _rms_of_finite(before) > 0
        else 1.0
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        own = np.where(before > 0, last / before, np.where(last > 0, 1.0, 0.0))
    pace = np.sqrt(common * np.clip(own, SHARE * common, 1.0))
    factor = np.clip(safety * pace, least, MOST)
    return np.asarray(np.where(np.isnan(before), MOST, factor))


def ratio_remainder(frequencies: Sequence[Array], least: float, apart: float) -> Array:
    """Return relative errors of the ratios of frequencies to their first.

    Low degrees may err so alike that ratios seem to settle at once: they settle no faster than the
    frequencies do. A single ratio may agree between two degrees by chance: it keeps such a part of
    the errors of its two frequencies as is usual among all.

    Args: frequencies: fine, coarse and coarsest, or two of them. least: of the last difference,
        what is left at least. apart: the same of what the ratio keeps of its frequencies.
    """
    f = frequencies[0]
    left = share_left(*steps(frequencies, f), SAFETY, least)
    ratios = [each / each[0] for each in frequencies]
    own = remainder(ratios, ratios[0], np.maximum(left, left[0]), 1.0) / ratios[0]
    relative = remainder(frequencies, f, max(least, apart)) / f
    both = relative + relative[0]
    kept = np.maximum(own, _unlike(frequencies) * both) + UNLIKE * both
    return np.asarray(np.minimum(kept, both))


def _unlike(frequencies: Sequence[Array]) -> float:
    """Return the usual change of a ratio over the changes of its two frequencies, 0 to 1."""
    fine, coarse = frequencies[:2]
    change = np.abs(coarse / fine - 1)
    of_ratio = np.abs((coarse / fine) / (coarse[0] / fine[0]) - 1)
    together = _rms_of_finite((change + change[0])[1:])
    return min(_rms_of_finite(of_ratio[1:]) / together, 1.0) if together > 0 else 0.0


def _rms_of_finite(differences: Array) -> float:
    """Return the root mean square of the finite differences, NaN where there is none."""
    known = differences[np.isfinite(differences)]
    return float(np.sqrt(np.mean(known**2))) if known.size else np.nan
