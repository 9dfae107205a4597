"""How far the responses of a film to changes of its tension are followed."""

from dataclasses import dataclass

from femnl.core.modes import Modes
from femnl.mechanics.fem.elements import Space


@dataclass(frozen=True)
class Effort:
    """How far the responses of a film are followed.

    degree: of their elements; relaxed_degree: of those of u where the edge yields, at whose corners
    the stress is uneven, or the sides change; sides: u of stretched films that are solved; kept:
    amplitude, relative to a low mode in the norm of energy, from which a response is kept; further:
    whether responses of third order are followed.
    """

    degree: int
    relaxed_degree: int
    sides: tuple[float, ...]
    kept: float
    further: bool


MANY = 40_000
"""Unknowns beyond which a film takes less effort; one with few holes has less than half."""
LEAST_DEGREE = 2
"""Of the elements of responses: straight ones have no curvature."""
RELAXED_DEGREE = 4
SIDES_MOST = 0.0513
"""The largest |ln(1 + e/2)| of `aspect_ratio`, |e| ≤ 0.1."""


def effort_of(modes: Modes) -> Effort:
    """Return how far the responses of a film are followed: less on a mesh of many unknowns.

    There the elements have the highest degree with fewer than `MANY`. With a lattice of 900 holes a
    frequency is then right to 3e-6 under other stresses, to 1e-5 on a yielding edge and to 4e-5
    with other sides, where base modes alone miss up to 3e-4.
    """
    degree = modes.degree
    while degree > LEAST_DEGREE and Space(modes.domain.mesh, degree).size > MANY:
        degree -= 1
    if degree == modes.degree:
        shares = (-1.0, -0.5, 0.5, 1.0)
        return Effort(degree, RELAXED_DEGREE, tuple(SIDES_MOST * s for s in shares), 2e-5, True)
    return less_effort(degree)


def less_effort(degree: int) -> Effort:
    """Return how far responses are followed in elements of a lower degree than the modes have."""
    return Effort(degree, RELAXED_DEGREE - 1, (-SIDES_MOST, SIDES_MOST), 1e-4, False)
