"""`femnl import SOURCE… DEST`: what labs have, as a measurement file."""

from pathlib import Path
from typing import Annotated

import typer

from femnl.cli._inputs import there
from femnl.cli._output import note
from femnl.core.resources import need_file


def _described(spec: Path | None) -> Path | None:
    """Refuse a description that is not there before anything heavy is loaded."""
    return None if spec is None else need_file(spec)


Sources = Annotated[
    list[Path],
    typer.Argument(
        help="Lab file(s): tables (CSV, .txt), MATLAB .mat, HDF5, LabOne, LabVIEW (.lvm, .tdms), "
        "NumPy .npy, .wav, Gwyddion, Nanonis, traces and ring-downs of signal analysers.",
        show_default=False,
        callback=there,
    ),
]
Dest = Annotated[
    Path, typer.Argument(help="Measurement file (.nc) to write, last.", show_default=False)
]
Spec = Annotated[
    Path | None,
    typer.Option(
        help="TOML that maps columns or variables to quantities and units.",
        show_default=False,
        callback=_described,
    ),
]


def command(sources: Sources, dest: Dest, spec: Spec = None) -> None:
    """Import lab files into one measurement file; every repair is listed."""
    from femnl.io.labfiles import import_file

    tree = import_file(sources[0] if len(sources) == 1 else sources, dest, spec)
    for repair in tree.attrs["repairs"]:
        note(f"repaired: {repair}")
    note(f"wrote {dest}")
