"""What gas takes from a film at most: the unit that the ranges of its damping count in."""

import numpy as np

from femnl.core.device import Film

GAS_CONSTANT = 8.314462618
NITROGEN = 0.0280134
"""Molar mass [kg/mol]."""
ROOM = 295.0
"""Temperature of the gas [K]."""


def free_molecular_loss(film: Film, frequency: float) -> float:
    """Return 1/(Qp) [1/Pa] of a film with nitrogen of room temperature on both sides.

    Q = (π/2)^{3/2} ρhf √(RT/M)/p: molecules hit the film, forget their velocity and leave, with a
    mean free path long against the film and no wall near by.

    Source: Christian, Vacuum 16, 175 (1966); Bao et al., J. Micromech. Microeng. 12, 341 (2002).
    """
    inertia = film.density * film.thickness * frequency
    return float((2 / np.pi) ** 1.5 / inertia * np.sqrt(NITROGEN / (GAS_CONSTANT * ROOM)))
