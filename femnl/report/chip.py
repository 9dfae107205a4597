"""One page for one chip, for whoever makes the next wafer; and its numbers as files."""

import csv
import json
import shlex
from dataclasses import asdict
from functools import partial
from pathlib import Path

from femnl.chip.result import ChipFit, Quantity
from femnl.chip.words import chance, common, deviating, left_out, percent, variation
from femnl.core.json_values import json_value
from femnl.core.numbers import with_error
from femnl.io.results.atomic import make_folder, write_text_whole, write_whole
from femnl.plot.chip import chip_figure
from femnl.report.picture import embed
from femnl.report.provenance import provenance
from femnl.report.template import template

VERSION = "1.0"


def write_chip(fit: ChipFit, study: Path, folder: Path) -> list[Path]:
    """Write chip.json, devices.csv and report.html into a folder, made where it is missing."""
    make_folder(folder)
    numbers = json_value({"femnl_chip": VERSION, **asdict(fit)})
    text = json.dumps(numbers, indent=1, ensure_ascii=False, allow_nan=False)
    quantities = [q for q in (fit.frequency, fit.quality) if q is not None]
    page = template("chip.html.j2").render(
        fit=fit,
        sentences=[_sentence(q) for q in quantities],
        numbers=[(q.name, common(q, fit)) for q in quantities],
        devices=[(q.name, deviating(q), left_out(q)) for q in quantities],
        causes=[[c.device, c.name, chance(c.probability), c.words] for c in fit.causes],
        film=_film(fit),
        picture=embed(
            chip_figure(fit),
            "Maps of the chip and deviations of its devices",
            "Colours are deviations; a ring marks a device that deviates from the chip. On the "
            "right each device beside what all others predict; bars are one standard deviation.",
        ),
        command=shlex.join(["femnl", "chip", str(study), "--out", str(folder)]),
        provenance=provenance([]),
    )

    write_text_whole(folder / "chip.json", text)
    write_text_whole(folder / "report.html", page)
    write_whole(folder / "devices.csv", partial(_write_devices, quantities))
    return [folder / name for name in ("report.html", "chip.json", "devices.csv")]


def _sentence(quantity: Quantity) -> str:
    return (
        f"{quantity.name}: {variation(quantity)}; devices scatter by {percent(quantity.spread)} "
        "beside that"
    )


def _film(fit: ChipFit) -> list[list[str]]:
    if fit.film is None:
        return []
    rows = [[name, chance(p)] for name, p in fit.film.causes.items()]
    return rows + [
        [p.name, f"{with_error(p.value, p.sd, 2)} {'' if p.unit == '1' else p.unit}"]
        for p in fit.film.parameters
    ]


def _write_devices(quantities: list[Quantity], path: Path) -> None:
    head = ["quantity", "device", "mode", "design", "x", "y", "value", "predicted"]
    with path.open("w", encoding="utf-8", errors="backslashreplace", newline="") as file:
        rows = csv.writer(file)
        rows.writerow([*head, "log_ratio", "sd", "sigma", "outlier"])
        for q in quantities:
            for d in q.devices:
                about = [q.name, d.device, d.mode, d.design, *d.place]
                rows.writerow([*about, d.value, d.predicted, d.log_ratio, d.sd, d.sigma, d.outlier])
