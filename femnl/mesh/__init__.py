"""Meshes of the film: gmsh is imported here and nowhere else."""

from femnl.mesh.build import mesh
from femnl.mesh.symmetry import WEDGES, has_symmetry

__all__ = ["WEDGES", "has_symmetry", "mesh"]
