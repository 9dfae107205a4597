"""Meshes, modes and stress in formats that other programs open.

Meshio, which knows them all, is loaded when one is written.
"""

from pathlib import Path

import numpy as np

from femnl.core.domain import Domain
from femnl.core.errors import ParameterError
from femnl.core.modes import Modes
from femnl.io.results.atomic import write_whole
from femnl.io.results.surface import unfold
from femnl.mechanics.fem.elements import Space


def write_vtu(path: Path, modes: Modes) -> None:
    """Write the whole film as quadratic triangles with shapes, stress and thickness at nodes."""
    import meshio

    surface = unfold(modes)
    names = [
        f"mode_{k + 1}" + (f"_{label}" if label else "") for k, label in enumerate(modes.label)
    ]
    fields = dict(zip(names, surface.shapes, strict=True))
    fields |= {
        f"stress_{axes}_Pa": surface.stress[:, k] for k, axes in enumerate(("xx", "yy", "xy"))
    }
    fields["in_plane_m"] = np.column_stack([surface.in_plane, np.zeros(len(surface.points))])
    fields["thickness_m"] = surface.thickness
    points = np.column_stack([surface.points, np.zeros(len(surface.points))])
    mesh = meshio.Mesh(points, [("triangle6", surface.triangles)], point_data=fields)
    write_whole(path, lambda file: mesh.write(file, file_format="vtu"))


def write_mesh(path: Path, domain: Domain) -> None:
    """Write the mesh of a film or of its wedge in the format of the suffix of `path`.

    meshio knows the formats.

    Raises: ParameterError for a suffix that meshio does not write.
    """
    import meshio

    check_suffix(path)
    points = domain.mesh.doflocs.T
    nodes = Space(domain.mesh, 2).dofs
    mesh = meshio.Mesh(np.column_stack([points, np.zeros(len(points))]), [("triangle6", nodes)])
    write_whole(path, lambda file: mesh.write(file))


def check_suffix(path: Path) -> None:
    """Refuse a name whose suffix meshio does not know. Raises: ParameterError."""
    import meshio

    if path.suffix not in meshio.extension_to_filetypes:
        raise ParameterError(
            f"{path}: meshio writes no files that end in '{path.suffix}'; use .vtu, .msh or .xdmf"
        )
