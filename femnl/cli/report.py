"""`femnl report`: femnl's evidence, or one device, on one page."""

from pathlib import Path
from typing import Annotated

import typer

from femnl.cli._device import Cache, OptionalGeometry
from femnl.cli._output import note


def command(
    geometry: OptionalGeometry = None,
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
    """Write the validation report, or one on a device: a page that needs no other file."""
    from femnl.io.results.atomic import make_folder

    browser = None
    if pdf:
        from femnl.report.paper import find_browser

        browser = find_browser()
    make_folder(out)
    from femnl.report.paper import print_page
    from femnl.report.write import write_device, write_report

    if geometry is None:
        page = write_report(out, note, cache)
    else:
        page = write_device(geometry, out, note, cache)
    note(f"wrote {page}")
    if browser is not None:
        note(f"wrote {print_page(page, browser)}")
