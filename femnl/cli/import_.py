"""`femnl import SOURCE… DEST`: what labs have, as a measurement file."""

from pathlib import Path
from typing import Annotated

import typer

from femnl.cli._inputs import there
from femnl.cli._output import note
from femnl.core.errors import ParameterError
from femnl.core.resources import need_file


def _described(spec: Path | None) -> Path | None:
    """Refuse a description that is not there before anything heavy is loaded."""
    return None if spec is None else need_file(spec)


def _with_destination(paths: list[Path]) -> list[Path]:
    """Refuse sources without a destination, and sources that are not there."""
    if len(paths) == 1:
        raise ParameterError(
            f"{paths[0]} alone: name the measurement file to write last, such as {paths[0].stem}.nc"
        )
    return [*there(paths[:-1]), paths[-1]]


Paths = Annotated[
    list[Path],
    typer.Argument(
        metavar="FILE",
        help="Lab file(s): tables (CSV, .txt), MATLAB .mat, HDF5, LabOne, LabVIEW (.lvm, .tdms), "
        "NumPy .npy, .wav, Gwyddion, Nanonis, traces and ring-downs of signal analysers. Last, "
        "the measurement file (.nc) to write.",
        show_default=False,
        callback=_with_destination,
    ),
]
Spec = Annotated[
    Path | None,
    typer.Option(
        help="TOML that maps columns or variables to quantities and units.",
        show_default=False,
        callback=_described,
    ),
]


def command(paths: Paths, spec: Spec = None) -> None:
    """Import lab files into one measurement file, named last; every repair is listed."""
    from femnl.io.labfiles import import_file

    *sources, dest = paths
    tree = import_file(sources[0] if len(sources) == 1 else sources, dest, spec)
    for repair in tree.attrs["repairs"]:
        note(f"repaired: {repair}")
    note(f"wrote {dest}")
