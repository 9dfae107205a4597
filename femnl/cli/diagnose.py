"""`femnl diagnose FILE`: what the simulation gets wrong, and why."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from femnl.cli._device import EffectsFolder, Json, MeasurementFile
from femnl.cli._output import console, note, print_json, scientific, table

if TYPE_CHECKING:
    from femnl.core.diagnosis import Diagnosis

MOST = 4
"""Workers unless the user asks for more: the fits that do not wait for each other are about a
dozen.
"""
Geometry = Annotated[
    str | None, typer.Option(help="Geometry to use instead of the file's own.", show_default=False)
]
Workers = Annotated[
    int | None,
    typer.Option(
        min=1,
        help="Processes that fit side by side.",
        show_default=f"the processors at hand, at most {MOST}",
    ),
]
Out = Annotated[
    Path | None,
    typer.Option(help="Folder for diagnosis.json and report.html.", show_default="FILE-diagnosis"),
]


def command(
    file: MeasurementFile,
    geometry: Geometry = None,
    effects: EffectsFolder = None,
    workers: Workers = None,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Compare a measurement with the simulation, and name the physical cause of what deviates."""
    from femnl.diagnose import diagnose, record, write
    from femnl.effects import known
    from femnl.report.diagnosis import write_diagnosis

    found = diagnose(
        file,
        geometry,
        known(effects).values(),
        workers or min(MOST, len(os.sched_getaffinity(0))),
    )
    folder = out or (None if as_json else Path(f"{file.stem}-diagnosis"))
    if folder is not None:
        write(found, folder)
        write_diagnosis(found, folder)
    if as_json:
        print_json(record(found))
        return
    _show(found)
    note(f"wrote {folder}/diagnosis.json and {folder}/report.html")


def _show_shares(found: Diagnosis) -> None:
    """Say what each cause takes up, what remains, and what the data say of their noise."""
    left = found.remainder
    for told in found.shares:
        console().print(
            f"{told.cause} takes up {_percent(told.share)} of the deviation "
            f"(± {_percent(told.sd)}; alone {_percent(told.alone)})"
        )
    if left is not None:
        size = f"what remains, {left.in_units} at most"
        console().print(
            f"{size}, is significant: {left.where}" if left.significant else f"{size}, is noise"
        )
    for noise in found.noise:
        if noise.found != noise.stated or noise.correlation_length != 1:
            label = f"{noise.measurement}: " if noise.measurement else ""
            console().print(
                f"{label}the noise is {noise.found:.3g} {noise.unit}, stated "
                f"{noise.stated:.3g} {noise.unit}; {noise.correlation_length:.3g} neighbouring "
                "data count as one"
            )
    if found.excluded:
        worst = found.excluded[0]
        console().print(
            f"left out as glitches: {len(found.excluded)}, the largest of {worst.sigma:.3g}σ at "
            f"{worst.where}"
        )


def _percent(part: float) -> str:
    """Return a part in percent, with as many nines as it has."""
    return f"{100 * part:.4g} %" if part < 0.99 or part == 1 else f"{100 * part:.6g} %"


def _show(found: Diagnosis) -> None:
    causes = f": {', '.join(found.causes)}" if found.causes else ""
    p_value = f"{found.p_value:.2g}" if found.p_value else "below 1e-300"
    console().print(
        f"[bold]{found.verdict}[/bold]{causes} (probability {found.probability:.3g}, p-value "
        f"{p_value})"
    )
    console().print(found.where)
    _show_shares(found)
    rows = [
        [owner, name, scientific(p.value, 6), scientific(p.sd, 2), p.unit]
        for owner, own in found.parameters.items()
        for name, p in own.items()
    ]
    console().print(table("Parameters", ["of", "name", "value", "±", "unit"], rows))
    before = found.before
    after = found.after
    console().print(
        f"χ² per datum held out: {before.heldout_chi2_reduced:.4g} before, "
        f"{after.heldout_chi2_reduced:.4g} after, gain {found.gain:.4g}"
    )
    for other in found.alternatives[:5]:
        console().print(
            f"also tried: {', '.join(other.causes)}, probability {other.probability:.2g}"
        )
    console().print(found.measure_next)
