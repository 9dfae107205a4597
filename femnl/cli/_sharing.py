"""Work that is shared out to processes or to a Dask scheduler: options and progress."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated

import typer

from femnl.cli._output import PROGRESS, note
from femnl.core.errors import ParameterError
from femnl.core.processes import need_scheduler

EVERY = 60.0  # seconds between lines of progress where standard error is no terminal

Scheduler = Annotated[
    str | None,
    typer.Option(
        help="Address of a Dask scheduler, such as tcp://host:8786; or local, for one of its own.",
        show_default=False,
    ),
]


def workers_at_hand(workers: int | None, scheduler: str | None) -> int:
    """Return how many processes to start: those asked for, else one a processor.

    Raises: ParameterError where a scheduler has workers of its own, or where none is.
    """
    if workers is not None and scheduler not in (None, "local"):
        raise ParameterError(
            f"--workers {workers}: the scheduler at {scheduler} has workers of its own; leave "
            "--workers out"
        )
    if scheduler not in (None, "local"):
        need_scheduler(scheduler)
    return workers or len(os.sched_getaffinity(0))


@contextmanager
def progress(total: int, unit: str) -> Iterator[Callable[[int, int], None]]:
    """A bar on standard error, or a line now and then where that is no terminal.

    Called with how many are done, and how many of these have failed.
    """
    if sys.stderr.isatty():
        with PROGRESS.hush(), _bar(total) as tell:
            yield tell
        return
    last = time.monotonic()

    def write(done: int, failed: int) -> None:
        nonlocal last
        if time.monotonic() - last > EVERY:
            last = time.monotonic()
            note(f"{done} of {total} {unit}, {failed} failed")

    yield write


@contextmanager
def _bar(total: int) -> Iterator[Callable[[int, int], None]]:
    from rich import progress as rich
    from rich.console import Console

    columns = (
        rich.BarColumn(),
        rich.MofNCompleteColumn(),
        rich.TextColumn("{task.description}"),
        rich.TimeElapsedColumn(),
        rich.TimeRemainingColumn(),
    )
    with rich.Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("0 failed", total=total)

        def advance(done: int, failed: int) -> None:
            bar.update(task, completed=done, description=f"{failed} failed")

        yield advance
