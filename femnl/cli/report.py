"""`femnl report`: the two devices of the source paper, from mesh to harmonic maps, on one page."""

from pathlib import Path
from typing import Annotated

import typer

from femnl.cli._device import Cache
from femnl.cli._output import note


def command(
    out: Annotated[
        Path, typer.Option(help="Folder for index.html; it is made where missing.")
    ] = Path("report"),
    pdf: Annotated[
        bool,
        typer.Option(
            "--pdf", help="Print it to index.pdf too, by a Chromium or Chrome on the PATH."
        ),
    ] = False,
    cache: Cache = True,
) -> None:
    """Write the validation report: one page that needs no other file."""
    from femnl.report.paper import find_browser, print_page
    from femnl.report.write import write_report

    browser = find_browser() if pdf else None
    page = write_report(out, note, cache)
    note(f"wrote {page}")
    if browser is not None:
        note(f"wrote {print_page(page, browser)}")
