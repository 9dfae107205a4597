"""Waves in a film with a lattice of holes that has no edge: frequency against wave vector."""

from femnl.mechanics.bands.find import find_cell, find_lattice
from femnl.mechanics.bands.lattice import Cell, Lattice
from femnl.mechanics.bands.solve import Bands, solve_bands

__all__ = ["Bands", "Cell", "Lattice", "find_cell", "find_lattice", "solve_bands"]
