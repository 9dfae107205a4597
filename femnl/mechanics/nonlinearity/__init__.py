"""Geometric nonlinearity: cubic coefficients from the stretching that deflection causes.

Relaxed in plane.
"""

from femnl.mechanics.nonlinearity.cubic import (
    Pairs,
    energy_remainder,
    solve_nonlinearity,
    strain_energies,
)
from femnl.mechanics.nonlinearity.inertia import Inertia, respond, solve_inertia
from femnl.mechanics.nonlinearity.response import in_plane_response
from femnl.mechanics.nonlinearity.stretching import film_membrane

__all__ = [
    "Inertia",
    "Pairs",
    "energy_remainder",
    "film_membrane",
    "in_plane_response",
    "respond",
    "solve_inertia",
    "solve_nonlinearity",
    "strain_energies",
]
