"""`femnl view GEOMETRY`: mesh, stress, thickness and shapes as pictures."""

from pathlib import Path
from typing import Annotated

import typer

from femnl.cli._device import (
    Bending,
    Cache,
    Geometry,
    Resolution,
    Symmetry,
    check_mode,
    load_device,
    suffix_of,
)
from femnl.cli._output import note
from femnl.core.choices import PICTURE_FORMATS, PICTURES
from femnl.core.errors import ParameterError
from femnl.io.results.atomic import need_room

What = Annotated[str, typer.Argument(help="mesh, stress, shape or thickness.")]
Out = Annotated[
    Path | None,
    typer.Option(
        help="Picture to write: .png, .pdf or .svg; a window opens without it.", show_default=False
    ),
]


def command(
    geometry: Geometry,
    *,
    what: What = "shape",
    mode: Annotated[int, typer.Option(help="Which shape, from 1.")] = 1,
    out: Out = None,
    symmetry: Symmetry = "auto",
    resolution: Resolution = 1.0,
    bending: Bending = None,
    cache: Cache = True,
) -> None:
    """Show the mesh, the relaxed stress, the thickness or a mode shape.

    All but shapes are drawn without solving any mode.
    """
    if out:
        suffix_of(out, PICTURE_FORMATS)
        need_room(out)
    if what not in PICTURES:
        raise ParameterError(f"{what}: expected one of {', '.join(PICTURES)}")
    check_mode(mode)
    from femnl.pipeline import solve_modes, solve_release
    from femnl.plot.mechanics import view

    device = load_device(geometry, bending)
    if what == "shape":
        count = max(10, check_mode(mode) + 1)
        film = solve_modes(device, count, symmetry, resolution, cache)
    else:
        film = solve_release(device, symmetry, resolution)
    view(film, what, mode, out)
    if out:
        note(f"wrote {out}")
