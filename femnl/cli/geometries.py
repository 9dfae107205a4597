"""`femnl geometries`: what ships."""

from typing import Annotated

import typer

from femnl.cli._output import console, print_json, table
from femnl.core.resources import shipped


def command(
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """List the geometries that ship with femnl."""
    found = shipped()
    if as_json:
        print_json({"geometries": [{"name": name, "description": text} for name, text in found]})
        return
    console().print(table("Geometries", ["name", "device"], [[name, text] for name, text in found]))
