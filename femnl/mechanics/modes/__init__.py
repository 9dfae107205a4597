"""Prestressed modes: frequencies, effective masses, shapes and labels."""

from femnl.mechanics.modes.counterparts import align, certified, with_counterparts
from femnl.mechanics.modes.near import degrees_at_once, solve_modes_near
from femnl.mechanics.modes.points import ShapeValues, shape_at, shapes_at
from femnl.mechanics.modes.solve import (
    solve_modes,
    solve_pencil,
    solve_sectors,
    without_modes,
)

__all__ = [
    "ShapeValues",
    "align",
    "certified",
    "degrees_at_once",
    "shape_at",
    "shapes_at",
    "solve_modes",
    "solve_modes_near",
    "solve_pencil",
    "solve_sectors",
    "with_counterparts",
    "without_modes",
]
