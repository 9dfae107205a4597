"""Meshes of the film: gmsh is imported here and nowhere else."""

from femnl.mesh.build import bending_length, mesh
from femnl.mesh.symmetry import WEDGES, has_symmetry

__all__ = ["WEDGES", "bending_length", "has_symmetry", "mesh"]
