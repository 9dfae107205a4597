"""The grid of forms and scales that a hierarchy is summed over."""

from dataclasses import dataclass

import numpy as np

from femnl.chip.values import Array, Integers

FIELDS = ("none", "plane", "bowl")
"""Forms of the variation over the chip: the last has all terms of second order as well."""
PLANE = 2
TERMS = 5
"""Terms of a plane, and of a bowl with its plane."""
SPREADS = (0.02, 3.0)
"""Least and largest spread from device to device, in parts of what the devices show: the least
beside a bowl, the largest without any field."""
AMPLITUDES = np.geomspace(0.1, 10.0, 7)
"""Variation over the chip, in the same unit, for one standard deviation of the places."""
MODE_SPREADS = (0.02, 2.0)
"""Likewise the spread between modes of one device, which may also be none. It is not tied to that
from device to device: many modes tell it so well that a step of a common grid would drag the other
with it."""
STEP = 150 ** (1 / 15)
MODE_STEP = 100 ** (1 / 7)
"""Factors from one spread to the next."""


@dataclass(frozen=True)
class Scales:
    """Every form and scale that is summed over.

    field: of each. amplitude, spread, mode_spread: a, τ and κ in units of y. noise: number of the
    pair of τ and κ. log_prior: every form the same, and every scale within it.
    """

    field: tuple[str, ...]
    amplitude: Array
    spread: Array
    mode_spread: Array
    noise: Integers
    log_prior: Array


def grid(fields: tuple[str, ...], several: bool, unit: float, rest: float) -> Scales:
    """Return every combination of form and scales.

    Args:
        fields: forms of the variation, of `FIELDS`.
        several: whether a device has several modes; without, they cannot differ.
        unit: what devices differ by without any field, in units of y.
        rest: what they differ by beside a bowl, over the unit.
    """
    spreads = _steps(*SPREADS, STEP, rest)
    mode_spreads = [0.0, *_steps(*MODE_SPREADS, MODE_STEP, rest)] if several else [0.0]
    pairs = [(t, s) for t in spreads for s in mode_spreads]
    rows = [
        (field, amplitude, k)
        for field in fields
        for amplitude in (AMPLITUDES if field != "none" else (0.0,))
        for k in range(len(pairs))
    ]
    forms = [field for field, _, _ in rows]
    noise = np.array([k for _, _, k in rows])
    spread, part = np.array(pairs).T * unit
    return Scales(
        tuple(forms),
        np.array([a for _, a, _ in rows]) * unit,
        spread[noise],
        part[noise],
        noise,
        np.array([-np.log(forms.count(f) * len(fields)) for f in forms]),
    )


def _steps(least: float, largest: float, step: float, rest: float) -> list[float]:
    """Return spreads by equal factors, downwards from the largest to the least of the rest."""
    count = int(np.ceil(np.log(largest / (least * rest)) / np.log(step) - 1e-9)) + 1
    return [float(one) for one in largest / step ** np.arange(count)[::-1]]
