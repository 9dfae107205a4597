"""`femnl sweep SPEC`: many devices that differ in a few values."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from femnl.cli._device import Json, suffix_of
from femnl.cli._output import console, note, print_json, table
from femnl.cli._sharing import Scheduler, progress, workers_at_hand
from femnl.core.resources import need_file

if TYPE_CHECKING:
    from femnl.sweep import Report

Spec = Annotated[
    Path, typer.Argument(help="Sweep file, TOML.", show_default=False, callback=need_file)
]
Out = Annotated[
    Path | None,
    typer.Option(
        help="Store of results; tables beside it as .nc and .csv.", show_default="SPEC.jsonl"
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(help="Processes on this machine.", min=1, show_default="one a processor"),
]
Estimate = Annotated[
    bool,
    typer.Option("--estimate", help="Solve three points only, and say what all of them will take."),
]
Retry = Annotated[bool, typer.Option("--retry", help="Try points again that failed earlier.")]


def command(
    spec: Spec,
    *,
    out: Out = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    estimate: Estimate = False,
    retry: Retry = False,
    as_json: Json = False,
) -> None:
    """Solve many devices that differ in a few values; a repeated command goes on from there."""
    path = out or spec.with_suffix(".jsonl")
    suffix_of(path, (".jsonl",))
    number = workers_at_hand(workers, scheduler)
    from femnl.sweep import read_sweep

    sweep = read_sweep(spec)
    from femnl.sweep import costs, engine, need_room_for, open_store, run, write_tables

    solve = engine(scheduler, number)
    with open_store(
        path, sweep.settings, sweep.sample.seed if sweep.sample else None, retry
    ) as store:
        before = costs(sweep, store)
        if scheduler in (None, "local"):
            need_room_for(before, number)
        seed = f", seed {store.seed}" if sweep.sample else ""
        other = len(store.records) - before.points + before.missing
        beside = f"; the store has {other} more, of other sweeps" if other else ""
        note(
            f"{path}: {before.points} points{seed}, {before.points - before.missing} of them "
            f"known{beside}"
        )
        try:
            with progress(before.points, "points") as tell:
                run(sweep, store, solve, _counted(tell, before), pilots=estimate)
        except KeyboardInterrupt:
            store.reread()
            after = costs(sweep, store)
            note(
                f"{path}: {after.points - after.missing} of {after.points} points are kept; the "
                "same command goes on from here"
            )
            raise
        after = costs(sweep, store)
        if not estimate:
            tables = write_tables(path, sweep, store)
    record = _record(
        after,
        store.seed if sweep.sample else None,
        number if scheduler in (None, "local") else None,
    )
    if as_json:
        print_json(
            record
            | {"store": str(path)}
            | ({} if estimate else {"results": [str(name) for name in tables]})
        )
        return
    if estimate:
        _show_estimate(record)
    if after.failed:
        rows = [
            [str(count), reason]
            for reason, count in sorted(after.failed.items(), key=lambda item: -item[1])
        ]
        console().print(
            table("Points that failed; --retry tries them again", ["points", "reason"], rows)
        )
    if not estimate:
        note(
            f"wrote {tables[0]} and {tables[1]}: {after.solved} points solved, "
            f"{sum(after.failed.values())} failed"
        )


def _record(report: Report, seed: int | None, workers: int | None) -> dict[str, Any]:
    left = report.missing * report.seconds
    return {
        "points": report.points,
        "solved": report.solved,
        "failed": report.failed,
        "missing": report.missing,
        "seed": seed,
        "seconds_per_point": report.seconds,
        "memory_per_worker": report.memory,
        "seconds_left": left / workers if workers else left,
        "workers": workers,
        "store_size": report.size,
    }


def _show_estimate(record: dict[str, Any]) -> None:
    workers = record["workers"] or 1
    known = record["points"] - record["missing"]
    rows = [
        ["points, solved and missing", f"{record['solved']}", f"{record['missing']}"],
        [
            "a point",
            f"{record['seconds_per_point']:.2f} s",
            f"{record['memory_per_worker'] / 2**20:.0f} MiB",
        ],
        [
            f"all that are missing, on {workers} worker{'s' * (workers > 1)}",
            _duration(record["seconds_left"]),
            f"{workers * record['memory_per_worker'] / 2**20:.0f} MiB",
        ],
        [
            "the store in the end",
            "",
            f"{record['store_size'] / max(known, 1) * record['points'] / 2**20:.2g} MiB",
        ],
    ]
    console().print(
        table("Estimated from the points that are known", ["what", "time", "memory"], rows)
    )


def _duration(seconds: float) -> str:
    if not math.isfinite(seconds):
        return "–"
    return (
        f"{seconds:.0f} s"
        if seconds < 180
        else f"{seconds / 60:.0f} min"
        if seconds < 10800
        else f"{seconds / 3600:.1f} h"
    )


def _counted(tell: Callable[[int, int], None], report: Report) -> Callable[[dict[str, Any]], None]:
    """Return what tells of each record how many points are done, and how many have failed."""
    done = report.points - report.missing
    failed = sum(report.failed.values())
    tell(done, failed)

    def count(record: dict[str, Any]) -> None:
        nonlocal done, failed
        done += 1
        failed += "error" in record
        tell(done, failed)

    return count
