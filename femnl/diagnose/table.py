"""Diagnoses of many files: a row a file, side by side, and none lost by an interruption."""

import logging
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import closing
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from femnl.core.checkpoint import code_digest
from femnl.core.effect import Effect
from femnl.core.errors import ParameterError, warn_in_lines
from femnl.core.processes import Death, Worker, answer, dask, share_out
from femnl.diagnose.one_file import (
    Row,
    Settings,
    Task,
    attempt,
    failed,
    loaded,
    settings_of,
    task_of,
)
from femnl.diagnose.row_checkpoint import RowCheckpoint, open_checkpoint
from femnl.io.results.atomic import need_room, write_text_whole

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = (
    "file",
    "verdict",
    "causes",
    "shares",
    "p_value",
    "gain",
    "parameters",
    "seconds",
    "message",
)
HEAD = ",".join(COLUMNS)
EVERY = 10.0  # seconds between tables on disk; every row is in the checkpoint at once
AHEAD = 200
"""Files that a Dask scheduler holds at a time, with their contents."""
Tell = Callable[[int, int], object]
Answers = Generator[tuple[Task, Row], None, None]


def diagnose_many(
    paths: Iterable[str | Path],
    geometry: str | Path | None = None,
    effects: Iterable[Effect] | None = None,
    *,
    out: str | Path | None = None,
    workers: int = 1,
    scheduler: str | None = None,
    tell: Tell | None = None,
) -> "pd.DataFrame":
    """Diagnose many files, one in each process, and return a row for each.

    Args:
        paths: measurement files and lab files, which are imported on the way as `femnl import`
            does.
        geometry: name or path of a geometry to use instead of each file's own.
        effects: the causes to consider; the whole library unless given.
        out: CSV file of the same table. A checkpoint beside it (.jsonl) keeps every finished row,
            so that the same call goes on after an interruption.
        workers: files that are diagnosed side by side. As processes are started, a script keeps
            what it runs under `if __name__ == "__main__"`.
        scheduler: address of a Dask scheduler whose workers do it instead; "local" for one of
            `workers` processes on this machine.
        tell: is called with the numbers of rows that are finished, and of those that failed, each
            time that they change.

    Returns: a row for each path, in their order: file; verdict; causes, joined by " + "; shares;
        p_value; gain; parameters, with standard deviations and units; seconds; message, empty
        unless the file has no diagnosis.
    Raises: ParameterError, GeometryError and MissingLibraryError for what concerns all files; what
        concerns one is in its row.
    """
    files = [Path(path) for path in paths]
    table = None if out is None else Path(out)
    _refuse(files, table, workers)
    settings = settings_of(geometry, effects)
    tasks = [task_of(file, settings) for file in files]
    with open_checkpoint(None if table is None else table.with_suffix(".jsonl")) as checkpoint:
        missing = dict[str, Task]()
        for task in tasks:
            if task.key not in checkpoint.rows:
                missing.setdefault(task.key, task)
        _told(tell, tasks, checkpoint)
        written = time.monotonic()
        try:
            todo = list(missing.values())
            with closing(_answers(todo, settings, workers, scheduler)) as answers:
                for task, row in answers:
                    checkpoint.add(task.key, row)
                    _told(tell, tasks, checkpoint)
                    if time.monotonic() - written > EVERY:
                        _write(table, tasks, checkpoint)
                        written = time.monotonic()
        finally:
            _write(table, tasks, checkpoint)
        return _frame(tasks, checkpoint)


def _usual_ending(folder: Path) -> str:
    """Return the ending that most files of a folder have; that of measurement files if none."""
    endings = Counter(file.suffix for file in folder.iterdir() if file.is_file())
    return max(endings, key=endings.__getitem__, default=".nc")


def _refuse(files: Sequence[Path], table: Path | None, workers: int) -> None:
    """Refuse what no row could come of, before hours are spent."""
    if not files:
        raise ParameterError("no file given; name at least one")
    if workers < 1:
        raise ParameterError(f"workers: {workers} is none; give a whole number of at least 1")
    for file in files:
        if file.is_dir():
            like = f"{file}/*{_usual_ending(file)}"
            raise ParameterError(f"{file}: is a folder; name the files in it, such as {like}")
    if table is None:
        return
    if table.suffix != ".csv":
        raise ParameterError(f"--table {table}: expected a name that ends in .csv")
    need_room(table)
    places = {table.resolve(), table.with_suffix(".jsonl").resolve()}
    for file in files:
        if file.resolve() in places:
            raise ParameterError(
                f"{file}: is both a file to diagnose and the table of diagnoses; name another "
                "table with --table"
            )
    if table.exists() and _first_line(table) not in ("", HEAD):
        raise ParameterError(
            f"{table}: exists and is no table of diagnoses; name another with --table"
        )


def _first_line(table: Path) -> str:
    with table.open("rb") as file:
        return file.readline(4 * len(HEAD)).decode("utf-8", "replace").rstrip("\r\n")


def _answers(
    tasks: Sequence[Task], settings: Settings, workers: int, scheduler: str | None
) -> Answers:
    """Diagnose files on processes of this machine, or on the workers of a Dask scheduler."""
    if scheduler is None:
        return _on_processes(tasks, settings, min(workers, len(tasks)))
    return _on_cluster(tasks, settings, workers, scheduler)


def _on_processes(tasks: Sequence[Task], settings: Settings, workers: int) -> Answers:
    # One folder for all, since a process that is killed leaves what it made
    with TemporaryDirectory(prefix="femnl-") as folder:
        found = share_out(iter(tasks), partial(Worker, _serve, settings, folder), workers, _died)
        with closing(found) as answers:
            for task, row in answers:
                died = isinstance(row, Death)
                yield task, failed(f"{task.path}: {row}") if died else row


def _on_cluster(tasks: Sequence[Task], settings: Settings, workers: int, scheduler: str) -> Answers:
    cluster = dask(scheduler)
    where = cluster.Where(scheduler, workers, code_digest, AHEAD)
    found = cluster.share_out(iter(tasks), partial(attempt, settings=settings), where, loaded)
    with closing(found) as answers:
        for task, row in answers:
            if isinstance(row, BaseException):
                row = failed(f"{task.path}: on the cluster: {row!r}")
            yield task, row


def _died(task: Task, code: int) -> None:
    logging.getLogger("femnl").warning("a worker died (exit code %d) at %s", code, task.path)


def _serve(connection: Connection, settings: Settings, folder: str) -> None:
    warn_in_lines()
    answer(connection, partial(attempt, settings=settings, folder=folder))


def _told(tell: Tell | None, tasks: Sequence[Task], checkpoint: RowCheckpoint) -> None:
    if tell is not None:
        rows = [checkpoint.rows[task.key] for task in tasks if task.key in checkpoint.rows]
        tell(len(rows), sum(bool(row["message"]) for row in rows))


def _write(table: Path | None, tasks: Sequence[Task], checkpoint: RowCheckpoint) -> None:
    if table is not None:
        # pandas quotes no carriage return, which readers take for the end of a line
        frame = _frame(tasks, checkpoint).replace({"\r": r"\\r"}, regex=True)
        text = frame.to_csv(index=False, lineterminator="\n")
        write_text_whole(table, text)


def _frame(tasks: Sequence[Task], checkpoint: RowCheckpoint) -> "pd.DataFrame":
    """Return the rows that are finished, in the order of their files."""
    import pandas as pd

    first = dict[str, Path]()  # of files that are the same, the one that was diagnosed
    rows = []
    for task in tasks:
        path = first.setdefault(task.key, task.path)
        if task.key in checkpoint.rows:
            row = checkpoint.rows[task.key]
            message = row["message"]
            if message.startswith(str(path)):
                message = f"{task.path}{message.removeprefix(str(path))}"
            rows.append({"file": str(task.path), **row, "message": message})
    return pd.DataFrame(rows, columns=list(COLUMNS))
