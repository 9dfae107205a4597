"""`femnl mesh GEOMETRY`: the mesh alone."""

from pathlib import Path
from typing import Annotated

import typer

from femnl.cli._device import Bending, Geometry, Json, Resolution, Symmetry, load_device
from femnl.cli._output import console, note, print_json, table
from femnl.io.results.atomic import need_room

Out = Annotated[
    Path | None,
    typer.Option(
        help="Write the mesh in any format of meshio: .vtu, .msh, .xdmf, …", show_default=False
    ),
]


def command(
    geometry: Geometry,
    symmetry: Symmetry = "auto",
    resolution: Resolution = 1.0,
    bending: Bending = None,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Mesh a device and say what came out."""
    if out:
        from femnl.io.results.vtu import check_suffix

        check_suffix(out)
        need_room(out)
    from femnl.device.mesh import mesh

    domain = mesh(load_device(geometry, bending), symmetry, resolution, alone=True)
    boundaries = {name: len(facets) for name, facets in (domain.mesh.boundaries or {}).items()}
    if as_json:
        counts = {"triangles": domain.mesh.nelements, "vertices": domain.mesh.nvertices}
        print_json(
            {
                "geometry": domain.model.name,
                "copies": domain.copies,
                **counts,
                "boundaries": boundaries,
            }
        )
    else:
        parts = {
            "copies that make the film": domain.copies,
            "triangles": domain.mesh.nelements,
            "vertices": domain.mesh.nvertices,
        }
        rows = [[name, str(n)] for name, n in parts.items()]
        rows += [[f"edges on {name}", str(n)] for name, n in boundaries.items()]
        console().print(table(domain.model.name, ["mesh", "number"], rows))
    if out:
        from femnl.io.results.vtu import write_mesh

        write_mesh(out, domain)
        note(f"wrote {out}")
