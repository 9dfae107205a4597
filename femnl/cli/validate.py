"""`femnl validate`: every reference number against what femnl computes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from femnl.cli._device import Json
from femnl.cli._output import console, note, print_json
from femnl.core import resources
from femnl.core.errors import ParameterError

DATA = Path("..") / "shared" / "data"
"""Where published data that the repository does not hold are looked for: beside the repository."""
Published = Annotated[
    bool,
    typer.Option(
        "--published",
        help="Diagnose published measurements instead, beside what their authors say causes them.",
    ),
]
Data = Annotated[
    Path | None,
    typer.Option(
        help="With --published: folder of data that are published as files of their own.",
        show_default=str(DATA),
    ),
]
Names = Annotated[
    list[str] | None,
    typer.Argument(help="Cases to run; all of them where none is named.", show_default=False),
]


def command(
    names: Names = None, published: Published = False, data: Data = None, as_json: Json = False
) -> None:
    """Run the validation cases: femnl beside published and independent numbers.

    The status is 1 where one differs. Published measurements are told and not judged.
    """
    if published:
        _published(names or [], data or DATA, as_json)
        return
    if data is not None:
        raise ParameterError(f"--data {data}: is for published measurements; add --published")
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


def _published(names: list[str], data: Path, as_json: bool) -> None:
    """Diagnose published measurements and print what femnl and their authors say."""
    from femnl import published

    outcomes = []
    for outcome in published.run(resources.published(), names, data):
        outcomes.append(outcome)
        note(f"{outcome.name}: {outcome.agreement}")
    if as_json:
        print_json({"cases": [published.record(outcome) for outcome in outcomes]})
    else:
        console().print(published.render(outcomes))
