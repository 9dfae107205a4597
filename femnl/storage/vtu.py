"""Modes and stress as VTU, which ParaView and pyvista open."""

from pathlib import Path

import meshio
import numpy as np

from femnl.storage.atomic import write_whole
from femnl.storage.surface import unfold
from femnl.types.mechanics import Modes


def write_vtu(path: Path, modes: Modes) -> None:
    """Write the whole film as quadratic triangles with every mode shape, the relaxed stress and the thickness at the nodes."""
    surface = unfold(modes)
    names = [f"mode_{k + 1}" + (f"_{label}" if label else "") for k, label in enumerate(modes.label)]
    fields = dict(zip(names, surface.shapes, strict=True))
    fields |= {f"stress_{axes}_Pa": surface.stress[:, k] for k, axes in enumerate(("xx", "yy", "xy"))}
    fields["in_plane_m"] = np.column_stack([surface.in_plane, np.zeros(len(surface.points))])
    fields["thickness_m"] = surface.thickness
    points = np.column_stack([surface.points, np.zeros(len(surface.points))])
    mesh = meshio.Mesh(points, [("triangle6", surface.triangles)], point_data=fields)
    write_whole(path, lambda file: mesh.write(file, file_format="vtu"))
