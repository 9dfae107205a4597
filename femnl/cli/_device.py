"""Options that every command on a device shares."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import typer

from femnl.core import choices
from femnl.core.errors import ParameterError
from femnl.core.resources import find_geometry, geometries, need_folder, need_no_text

if TYPE_CHECKING:
    from femnl.core.device import Model

SYMMETRIES = get_args(choices.Symmetry)
EDGES: tuple[choices.Edge, ...] = get_args(choices.Edge)


def known_geometry(geometry: str | None) -> str | None:
    """Refuse a geometry that is not there before anything heavy is loaded."""
    if geometry is not None:
        find_geometry(geometry)
    return geometry


def _shipped(begun: str) -> list[str]:
    """Return names for the shell to complete."""
    return [path.stem for path in geometries().glob(f"{begun}*.toml")]


def _there(folder: Path | None) -> Path | None:
    """Refuse a folder that is not there before anything heavy is loaded."""
    return None if folder is None else need_folder(folder)


GEOMETRY = typer.Argument(
    help="A shipped name (see `femnl geometries`) or the path of a TOML file.",
    show_default=False,
    autocompletion=_shipped,
    callback=known_geometry,
)
Geometry = Annotated[str, GEOMETRY]
OptionalGeometry = Annotated[str | None, GEOMETRY]
MeasurementFile = Annotated[
    Path,
    typer.Argument(help="A measurement file (.nc).", show_default=False, callback=need_no_text),
]
EffectsFolder = Annotated[
    Path | None,
    typer.Option(
        "--effects",
        help="Folder of *.py files that define effects of your own; they are run.",
        show_default=False,
        callback=_there,
    ),
]
Bending = Annotated[
    bool | None,
    typer.Option(
        "--bending/--no-bending",
        help="Keep or drop the plate term; else as the file says.",
        show_default=False,
    ),
]
EdgeOption = Annotated[
    str | None,
    typer.Option(
        "--edge",
        help="In-plane edge of the nonlinearity: clamped, sliding or paper.",
        show_default=False,
    ),
]
Symmetry = Annotated[
    str,
    typer.Option(
        help=f"Part of the film to mesh: auto, {', '.join(SYMMETRIES)}.",
        callback=choices.check_symmetry,
    ),
]
Resolution = Annotated[
    float,
    typer.Option(
        help="Factor on the number of elements per length.", callback=choices.check_resolution
    ),
]
Cache = Annotated[bool, typer.Option("--cache/--no-cache", help="Use solutions kept on disk.")]
Count = Annotated[int, typer.Option("--count", "-n", help="How many modes.", min=1)]
Json = Annotated[
    bool,
    typer.Option(
        "--json", help="Print one JSON object in SI units, full precision, and nothing else."
    ),
]


def load_device(geometry: str, bending: bool | None = None, edge: str | None = None) -> Model:
    """Read the geometry and apply what the command line overrides."""
    if edge is not None and edge not in EDGES:
        raise ParameterError(f"--edge {edge}: expected one of {', '.join(EDGES)}")
    from femnl.device.geometry import load

    model = load(geometry)
    if bending is not None:
        model = replace(model, bending=bending)
    for known in EDGES:
        if edge == known:
            model = replace(model, edge=known)
    return model


def check_mode(mode: int) -> int:
    """Return the index of a mode that users count from 1."""
    if mode < 1:
        raise ParameterError(f"--mode {mode}: modes are counted from 1")
    return mode - 1


def suffix_of(path: Path, allowed: tuple[str, ...]) -> str:
    """Return the file's suffix, one of those allowed."""
    if path.suffix not in allowed:
        raise ParameterError(f"--out {path}: expected a name that ends in {' or '.join(allowed)}")
    return path.suffix
