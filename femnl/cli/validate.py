"""`femnl validate`: every reference number against what femnl computes."""

from typing import Annotated

import typer

from femnl.cli._device import Json
from femnl.cli._output import console, note, print_json
from femnl.core import resources


def command(
    names: Annotated[
        list[str] | None,
        typer.Argument(help="Cases to run; all of them where none is named.", show_default=False),
    ] = None,
    as_json: Json = False,
) -> None:
    """Run the validation cases: femnl beside published and independent numbers.

    The status is 1 where one differs.
    """
    from femnl import validation

    results = []
    for result in validation.run(resources.cases(), names or ()):
        results.append(result)
        note(f"{result.name}: {'agrees' if result.passed else 'DIFFERS'}")
    if as_json:
        print_json({"cases": [validation.record(result) for result in results]})
    else:
        console().print(validation.render(results))
    if not all(result.passed for result in results):
        raise typer.Exit(1)
