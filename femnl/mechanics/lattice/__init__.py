"""Films with a lattice of holes.

Put together from condensed cells, or seen from afar as an even film.
"""

from femnl.mechanics.lattice.cell import Cell, solve_cell
from femnl.mechanics.lattice.condensed import solve_condensed
from femnl.mechanics.lattice.film import solve_homogenised
from femnl.mechanics.lattice.stretching import strain_energies
from femnl.mechanics.lattice.tiling import obstacle, tile

__all__ = [
    "Cell",
    "obstacle",
    "solve_cell",
    "solve_condensed",
    "solve_homogenised",
    "strain_energies",
    "tile",
]
