"""`femnl chip STUDY`: all devices of a chip together."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from femnl.cli._device import Json
from femnl.cli._output import console, note, print_json, table
from femnl.core.resources import need_file

if TYPE_CHECKING:
    from rich.console import Group

    from femnl.chip import ChipFit
    from femnl.chip.result import Quantity

Study = Annotated[
    Path, typer.Argument(help="Study file, TOML.", show_default=False, callback=need_file)
]
Out = Annotated[
    Path | None,
    typer.Option(help="Folder for chip.json, devices.csv and report.html.", show_default=False),
]
SHOWN = 20
"""Devices that are listed, those that deviate most."""


def command(study: Study, *, out: Out = None, as_json: Json = False) -> None:
    """Fit all devices of a chip: what they share, how they vary over it, which deviate and why."""
    from femnl.chip import read_chip

    chip = read_chip(study)
    from femnl.chip import fit_chip

    fit = fit_chip(chip)
    if out is not None:
        from femnl.report.chip import write_chip

        for path in write_chip(fit, study, out):
            note(f"wrote {path}")
    if as_json:
        print_json(asdict(fit))
        return
    for line in fit.notes:
        note(line)
    _show(fit)


def _show(fit: ChipFit) -> None:
    from femnl.chip.words import chance, common, deviating, left_out
    from femnl.core.numbers import with_error

    for quantity in (fit.frequency, fit.quality):
        if quantity is None:
            continue
        console().print(table(f"{quantity.name} of {fit.name}", ["", ""], common(quantity, fit)))
    if fit.film is not None:
        rows = [
            [p.name, with_error(p.value, p.sd, 2), "" if p.unit == "1" else p.unit]
            for p in fit.film.parameters
        ]
        leading = f"{fit.film.leading}, probability {chance(fit.film.causes[fit.film.leading])}"
        console().print(table(f"Film of all designs: {leading}", ["", "value", "unit"], rows))
        note(f"measure next: {fit.film.measure_next}")
    if fit.causes:
        rows = [[c.device, c.name, chance(c.probability), c.words] for c in fit.causes]
        head = ["device", "cause", "probability", "what is seen"]
        console().print(table("Devices that deviate", head, rows))
    console().print(_devices(fit.frequency, deviating(fit.frequency)[:SHOWN]))
    for quantity in (fit.frequency, fit.quality):
        if quantity is not None:
            note(left_out(quantity))


def _devices(quantity: Quantity, rows: list[list[str]]) -> Group:
    head = ["device", "mode", "design", quantity.name, "predicted", "deviation", "σ", "outlier"]
    return table(f"Largest deviations of {quantity.name}", head, rows)
