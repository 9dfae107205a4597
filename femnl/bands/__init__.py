"""Waves in a film with a lattice of holes that has no edge: frequency against wave vector."""

from femnl.bands.lattice import Lattice, find_lattice
from femnl.bands.solve import Bands, solve_bands

__all__ = ["Bands", "Lattice", "find_lattice", "solve_bands"]
