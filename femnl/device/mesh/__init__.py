"""Meshes of the film: gmsh is imported here and nowhere else."""

from femnl.device.mesh.build import mesh
from femnl.device.mesh.collect import distinct, from_patches
from femnl.device.mesh.grading import bending_length
from femnl.device.mesh.layers import covered, covers
from femnl.device.mesh.symmetry import WEDGES, film_middle, has_symmetry
from femnl.device.mesh.waves import shortest_wave, wave_at

__all__ = [
    "WEDGES",
    "bending_length",
    "covered",
    "covers",
    "distinct",
    "film_middle",
    "from_patches",
    "has_symmetry",
    "mesh",
    "shortest_wave",
    "wave_at",
]
