"""Geometric nonlinearity: the stretching that deflection causes, relaxed in plane, as cubic coefficients of the modes."""

from femnl.nonlinearity.cubic import Pairs, energy_remainder, solve_nonlinearity, strain_energies
from femnl.nonlinearity.inertia import Inertia, respond, solve_inertia
from femnl.nonlinearity.response import in_plane_response
from femnl.nonlinearity.stretching import film_membrane

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
