"""Prestressed modes: frequencies, effective masses, shapes and labels."""

from femnl.modes.shapes import shape_at, shapes_at
from femnl.modes.solve import align, solve_modes, solve_pencil, solve_sectors

__all__ = ["align", "shape_at", "shapes_at", "solve_modes", "solve_pencil", "solve_sectors"]
