"""`femnl report`: the two devices of the source paper, from mesh to harmonic maps, on one page."""

from pathlib import Path
from typing import Annotated

import typer

from femnl.cli._device import Cache
from femnl.cli._output import note
from femnl.report.write import write_report


def command(
    out: Annotated[Path, typer.Option(help="Folder for index.html; it is made where missing.")] = Path("report"),
    cache: Cache = True,
) -> None:
    """Write the validation report: one page that needs no other file."""
    note(f"wrote {write_report(out, note, cache)}")
