"""The grid of forms and scales that a hierarchy is summed over."""

from dataclasses import dataclass

import numpy as np

from femnl.chip.values import Array, Integers

FIELDS = ("none", "plane", "bowl")
"""Forms of the variation over the chip: the last has all terms of second order as well."""
PLANE = 2
TERMS = 5
"""Terms of a plane, and of a bowl with its plane."""
SPREADS = np.geomspace(0.02, 3.0, 16)
"""Spread from device to device, in parts of what the devices show without any field."""
AMPLITUDES = np.geomspace(0.1, 10.0, 7)
"""Variation over the chip, in the same unit, for one standard deviation of the places."""
MODE_SPREADS = (0.0, *np.geomspace(0.02, 2.0, 8))
"""Spread between modes of one device, in the same unit. It is not tied to that from device to
device: many modes tell it so well that a step of a common grid would drag the other with it."""


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


def grid(fields: tuple[str, ...], several: bool, unit: float) -> Scales:
    """Return every combination of form and scales.

    Args:
        fields: forms of the variation, of `FIELDS`.
        several: whether a device has several modes; without, they cannot differ.
        unit: what scales are counted in, in units of y.
    """
    mode_spreads = MODE_SPREADS if several else (0.0,)
    pairs = [(t, s) for t in SPREADS for s in mode_spreads]
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
