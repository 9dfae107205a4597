"""`femnl geometry import|export|check`: layouts and geometry files."""

from pathlib import Path
from typing import Annotated

import typer

from femnl.cli._device import Geometry
from femnl.cli._output import note
from femnl.core.resources import find_geometry, need_file

Layout = Annotated[
    Path,
    typer.Argument(
        help="Layout: .gds, .oas, .dxf or .svg.", show_default=False, callback=need_file
    ),
]
Dest = Annotated[Path, typer.Argument(help="Geometry file (.toml) to write.", show_default=False)]
Drawn = Annotated[Path, typer.Argument(help="Layout (.gds, .oas) to write.", show_default=False)]
File = Annotated[
    str,
    typer.Argument(
        help="A shipped name, a geometry file, or a layout with --layers.", show_default=False
    ),
]
Layers = Annotated[
    str,
    typer.Option(
        help="Layer of film, holes, release, frame, posts and metal: film=1/0,holes=2/0.",
        show_default=False,
    ),
]
LayersToCheck = Annotated[
    str | None, typer.Option("--layers", help="As for import.", show_default=False)
]
Cell = Annotated[
    str | None,
    typer.Option(help="Cell or block; else the one at the top.", show_default=False),
]
Unit = Annotated[
    str | None,
    typer.Option(help="Unit of a DXF or SVG file that names none: um.", show_default=False),
]
LIKE = "square-270um"
Like = Annotated[
    str,
    typer.Option(help="Geometry that lends its film, readout, clamp and model."),
]
Metal = Annotated[
    str | None,
    typer.Option(
        help="Numbers of the layer metal: thickness=30 nm,young=70 GPa,stress=50 MPa.",
        show_default=False,
    ),
]
Picture = Annotated[
    Path | None,
    typer.Option(help="Picture to write: .png, .pdf or .svg.", show_default="FILE.png here"),
]


def import_(
    layout: Layout,
    dest: Dest,
    *,
    layers: Layers,
    cell: Cell = None,
    unit: Unit = None,
    like: Like = LIKE,
    metal: Metal = None,
) -> None:
    """Turn a layout into a geometry file; arcs drawn as chords become arcs."""
    from femnl.core.errors import ParameterError
    from femnl.device.geometry import load
    from femnl.device.layout import import_layout, read_layers, read_metal
    from femnl.io.results.atomic import need_room, write_text_whole

    if dest.suffix != ".toml":
        raise ParameterError(f"{dest}: expected a name that ends in .toml")
    if dest.exists():
        raise ParameterError(
            f"{dest}: is there already, maybe with numbers of yours; give another name, or delete "
            "it"
        )
    need_room(dest)
    numbers = read_metal(metal) if metal is not None else None
    lender = load(find_geometry(like))
    found = import_layout(layout, read_layers(layers), lender, cell, unit, numbers)
    write_text_whole(dest, found.text)
    for line in found.notes:
        note(line)
    note(f"wrote {dest}")


def export(geometry: Geometry, dest: Drawn) -> None:
    """Draw a geometry as a layout."""
    from femnl.core.errors import ParameterError
    from femnl.device.geometry import load
    from femnl.device.layout import WRITTEN, export_layout
    from femnl.io.results.atomic import need_room, write_whole

    if dest.suffix not in WRITTEN:
        raise ParameterError(f"{dest}: expected a name that ends in {' or '.join(WRITTEN)}")
    need_room(dest)
    model = load(geometry)
    notes: list[str] = []
    write_whole(dest, lambda file: notes.extend(export_layout(model, file)))
    for line in notes:
        note(line)
    note(f"wrote {dest}")


def check(
    file: File,
    *,
    layers: LayersToCheck = None,
    cell: Cell = None,
    unit: Unit = None,
    like: Like = LIKE,
    metal: Metal = None,
    out: Picture = None,
) -> None:
    """Draw a geometry or a layout with what is wrong marked, and the stress after release."""
    from femnl.cli._device import suffix_of
    from femnl.core.errors import ParameterError
    from femnl.device.geometry import load
    from femnl.device.geometry.reader import read_text
    from femnl.device.layout import SUFFIXES, read_layers, read_metal
    from femnl.io.results.atomic import need_room

    path = Path(file)
    picture = out or Path(f"{path.stem}.png")
    suffix_of(picture, (".png", ".pdf", ".svg"))
    need_room(picture)
    if path.suffix.lower() not in SUFFIXES:
        if (layers, cell, unit, like, metal) != (None, None, None, LIKE, None):
            raise ParameterError(
                f"{path}: --layers, --cell, --unit, --like and --metal are for layouts; leave them "
                "out for a geometry"
            )
        known = find_geometry(file)
        text = read_text(known)  # before figures and meshers load
        from femnl.cli._check import check_geometry

        check_geometry(known, text, picture)
        return
    if layers is None:
        raise ParameterError(f"{path}: --layers is missing; write e.g. --layers film=1/0,holes=2/0")
    numbers = read_metal(metal) if metal is not None else None
    lender = load(find_geometry(like))
    roles = read_layers(layers)
    need_file(path)
    from femnl.cli._check import check_layout

    check_layout(path, roles, picture, like=lender, cell=cell, unit=unit, metal=numbers)


COMMANDS = {"import": import_, "export": export, "check": check}


def command() -> None:
    """Turn layouts into geometries and back, and check either in a picture."""
