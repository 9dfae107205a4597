"""`femnl diagnose FILE`: what the simulation gets wrong, and why."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from femnl.cli._device import EffectsFolder, Json, known_geometry
from femnl.cli._output import console, note, print_json, table
from femnl.cli._sharing import Scheduler, progress, workers_at_hand
from femnl.core.errors import ParameterError
from femnl.core.numbers import engineering
from femnl.core.resources import need_no_text

if TYPE_CHECKING:
    import pandas as pd

    from femnl.core.contributions import Account, Contributions
    from femnl.core.diagnosis import Diagnosis

MOST = 4
"""Workers unless the user asks for more: the fits that do not wait for each other are about a
dozen.
"""
Files = Annotated[
    list[Path],
    typer.Argument(
        metavar="FILE",
        help="A measurement file (.nc); with --table many of them, and lab files as well.",
        show_default=False,
    ),
]
Geometry = Annotated[
    str | None,
    typer.Option(
        help="Geometry to use instead of each file's own.",
        show_default=False,
        callback=known_geometry,
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(
        min=1,
        help="Processes that fit side by side; with --table, each takes a file of its own.",
        show_default=f"the processors at hand, at most {MOST} without --table",
    ),
]
Out = Annotated[
    Path | None,
    typer.Option(
        help="Folder for diagnosis.json, contributions.csv and report.html.",
        show_default="FILE-diagnosis",
    ),
]
Table = Annotated[
    Path | None,
    typer.Option(
        "--table",
        help="CSV file with a row for each FILE; a repeated command goes on from there.",
        show_default=False,
    ),
]


def command(
    files: Files,
    *,
    geometry: Geometry = None,
    effects: EffectsFolder = None,
    workers: Workers = None,
    out: Out = None,
    table_file: Table = None,
    scheduler: Scheduler = None,
    as_json: Json = False,
) -> None:
    """Compare a measurement with the simulation, and name the physical cause of what deviates."""
    if table_file is not None:
        if out is not None:
            raise ParameterError(
                f"--out {out}: --table writes one row a file and no report; leave --out out"
            )
        number = workers_at_hand(workers, scheduler)
        _many(files, table_file, geometry, effects, (number, scheduler), as_json=as_json)
        return
    if scheduler is not None:
        raise ParameterError(
            f"--scheduler {scheduler}: shares out files, one each; add --table OUT.csv"
        )
    if len(files) > 1:
        raise ParameterError(
            f"{len(files)} files given; add --table OUT.csv for a row of each, or name one"
        )
    _one(need_no_text(files[0]), geometry, effects, workers, out, as_json=as_json)


def _one(
    file: Path,
    geometry: str | None,
    effects: Path | None,
    workers: int | None,
    out: Path | None,
    *,
    as_json: bool,
) -> None:
    """Diagnose one measurement file, and write its report."""
    from femnl.io.measurement import need_room
    from femnl.io.measurement.head import need_version

    # Both before the fits load
    need_version(file)
    need_room(file, "diagnose", workers or 1)
    from femnl.diagnose import diagnose, record, write
    from femnl.effects import known
    from femnl.report.diagnosis import write_diagnosis

    found = diagnose(
        file,
        geometry,
        known(effects).values(),
        workers or _workers_that_fit(file),
    )
    folder = out or (None if as_json else Path(f"{file.stem}-diagnosis"))
    if folder is not None:
        write(found, folder)
        write_diagnosis(found, folder)
    if as_json:
        print_json(record(found))
        return
    _show(found)
    table_too = "" if found.contributions is None else f", {folder}/contributions.csv"
    note(f"wrote {folder}/diagnosis.json{table_too} and {folder}/report.html")


def _workers_that_fit(file: Path) -> int:
    """Return how many processes to start where the user does not say: fewer for large files."""
    from femnl.io.measurement import need_room

    at_hand = min(MOST, len(os.sched_getaffinity(0)))
    for workers in range(at_hand, 1, -1):
        try:
            need_room(file, "diagnose", workers)
        except ParameterError:
            continue
        if workers < at_hand:
            note(f"{workers} workers of {at_hand}, as each holds the data and memory is short")
        return workers
    return 1


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


def _show_contributions(found: Contributions) -> None:
    """Say what each cause changes of each quantity, and how far the sum of causes is off."""
    for account in found.accounts:
        for cause in account.causes:
            size = f"by {_size(cause.rms, account)} rms"
            most = f"{_size(cause.largest, account)} at most, {cause.where}"
            changes = f"{size} ({most})" if cause.rms else "not at all"
            console().print(f"{cause.name} changes the {account.title} {changes}")
        if account.interaction.rms:
            console().print(
                f"together they change it by {_size(account.interaction.largest, account)} more "
                f"than their sum at {account.interaction.where}, "
                f"{_percent(account.interaction_part)} of the whole change"
            )


def _size(value: float, account: Account) -> str:
    return engineering(value, account.unit)


def _percent(part: float) -> str:
    """Return a part in percent, with as many nines as it has."""
    return f"{100 * part:.4g} %" if part < 0.99 or part == 1 else f"{100 * part:.6g} %"


def _many(
    files: list[Path],
    out: Path,
    geometry: str | None,
    effects: Path | None,
    sharing: tuple[int, str | None],
    *,
    as_json: bool,
) -> None:
    """Diagnose many files, and write a table of them.

    sharing: workers, and the scheduler if there is one.
    """
    from femnl.diagnose.table import diagnose_many
    from femnl.effects import known

    workers, scheduler = sharing
    with progress(len(files), "files") as tell:
        rows = diagnose_many(
            files,
            geometry,
            known(effects).values(),
            out=out,
            workers=workers,
            scheduler=scheduler,
            tell=tell,
        )
    if as_json:
        print_json({"table": str(out), "rows": rows.to_dict("records")})
        return
    _show_counts(rows)
    failed = int((rows["message"] != "").sum())
    note(f"wrote {out}: {len(rows) - failed} files diagnosed, {failed} failed")


def _show_counts(rows: pd.DataFrame) -> None:
    """Print how many files have each verdict with its causes, and why others have none."""
    # Many files may fail for one reason, whatever their names
    reasons = [
        message.removeprefix(f"{file}: ")
        for file, message in zip(rows["file"], rows["message"], strict=True)
    ]
    told = Counter(zip(rows["verdict"], rows["causes"], reasons, strict=True))
    lines = [
        [verdict or "failed", causes or reason, str(count)]
        for (verdict, causes, reason), count in told.most_common()
    ]
    console().print(table("Diagnoses", ["verdict", "causes or reason", "files"], lines))


def _show(found: Diagnosis) -> None:
    from rich.text import Text

    from femnl.report.parameters import parameter_rows

    causes = f": {', '.join(found.causes)}" if found.causes else ""
    p_value = f"{found.p_value:.2g}" if found.p_value else "below 1e-300"
    # Without causes there is no probability of them, and nothing after that differs from before
    odds = f"probability {found.probability:.3g}, " if found.causes else ""
    chances = f" ({odds}p-value {p_value})"
    console().print(Text.assemble((found.verdict, "bold"), causes, chances))
    console().print(found.where)
    if found.nearest:
        console().print(found.nearest)
    _show_shares(found)
    if found.contributions is not None:
        _show_contributions(found.contributions)
    values = ["without causes", "with them", "equations add"] if found.causes else ["value"]
    head = ["of", "name", *values, "unit"]
    console().print(table("Parameters", head, parameter_rows(found)))
    before = found.before
    after = found.after
    quality = f"χ² per datum held out: {before.heldout_chi2_reduced:.4g}"
    if found.causes:
        quality += f" before, {after.heldout_chi2_reduced:.4g} after, gain {found.gain:.4g}"
    console().print(quality)
    for other in found.alternatives[:5]:
        console().print(
            f"also tried: {', '.join(other.causes)}, probability {other.probability:.2g}"
        )
    console().print(found.measure_next)
    for assumed in found.notes:
        console().print(f"assumed: {assumed}")
