"""Films with a lattice of holes: put together from condensed cells, or seen from afar as an even film."""

from femnl.lattice.cell import Cell, solve_cell
from femnl.lattice.condensed import solve_condensed
from femnl.lattice.film import solve_homogenised
from femnl.lattice.stretching import strain_energies
from femnl.lattice.tiling import obstacle, tile

__all__ = ["Cell", "obstacle", "solve_cell", "solve_condensed", "solve_homogenised", "strain_energies", "tile"]
