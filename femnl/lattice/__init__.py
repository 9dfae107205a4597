"""The perforated film seen from afar: what one cell of its lattice amounts to, and modes of the even film that replaces it."""

from femnl.lattice.cell import Cell, solve_cell
from femnl.lattice.film import solve_homogenised

__all__ = ["Cell", "solve_cell", "solve_homogenised"]
