"""What gas takes from a film at most: the unit that the ranges of its damping count in."""

import numpy as np

from femnl.core.device import Film
from femnl.core.outline import Outline

GAS_CONSTANT = 8.314462618
NITROGEN = 0.0280134
"""Molar mass [kg/mol]."""
ROOM = 295.0
"""Temperature of the gas [K]."""
BOLTZMANN = 1.380649e-23
DIAMETER = 0.37e-9
"""Of a molecule of nitrogen as it hits others [m]."""


def free_molecular_loss(film: Film, frequency: float) -> float:
    """Return 1/(Qp) [1/Pa] of a film with nitrogen of room temperature on both sides.

    Q = (π/2)^{3/2} ρhf √(RT/M)/p: molecules hit the film, forget their velocity and leave, with a
    mean free path long against the film and no wall near by.

    Source: Christian, Vacuum 16, 175 (1966); Bao et al., J. Micromech. Microeng. 12, 341 (2002).
    """
    inertia = film.density * film.thickness * frequency
    return float((2 / np.pi) ** 1.5 / inertia * np.sqrt(NITROGEN / (GAS_CONSTANT * ROOM)))


def crossing_time(outline: Outline) -> float:
    """Return the time [s] in which nitrogen of room temperature flies out from under a film.

    τ = (2/π)^{3/2} P/(8√(RT/M)), P the perimeter: with it the loss of gas that leaves fast,
    pτ/(ρhdω), is that of free molecular flow times P/(16πd). P is taken as 4L.

    Source: Bao et al., J. Micromech. Microeng. 12, 341 (2002), the energy transfer model.
    """
    perimeter = 4 * outline.length
    thermal = np.sqrt(GAS_CONSTANT * ROOM / NITROGEN)
    return float((2 / np.pi) ** 1.5 * perimeter / (8 * thermal))


def mean_free_path(pressure: float) -> float:
    """Return the mean free path [m] of nitrogen of room temperature at a pressure above 0 [Pa].

    λ = k_B T/(√2 π d² p).
    """
    return float(BOLTZMANN * ROOM / (np.sqrt(2) * np.pi * DIAMETER**2 * pressure))
