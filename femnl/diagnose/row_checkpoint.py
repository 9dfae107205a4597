"""Rows of a table of diagnoses on disk, so that an interrupted table goes on where it stopped."""

import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from femnl.core.errors import ParameterError
from femnl.diagnose.one_file import Row, failed
from femnl.io.results.atomic import need_room, write_whole
from femnl.io.results.lines import append, hold, json_line, set_aside

BEGIN = b'{"femnl_row": '
"""How every line of a checkpoint begins."""
HELD = "another femnl diagnose is writing to this table; wait for it, or name another with --table"


class RowCheckpoint:
    """Rows by the keys of their files, open for more; in memory alone where there is no file."""

    def __init__(self, rows: dict[str, Row], file: IO[bytes] | None) -> None:
        self.rows = rows
        self._file = file

    def add(self, key: str, row: Row) -> None:
        """Keep a row, and write it to disk unless its file failed.

        A file that failed is tried again by the next command.
        """
        self.rows[key] = row
        if self._file is not None and not row["message"]:
            append(self._file, {"femnl_row": key, "sum": _sum(key, row), "row": row})


@contextmanager
def open_checkpoint(path: Path | None) -> Iterator[RowCheckpoint]:
    """Open a checkpoint for this process alone, or begin one; a damaged line is told and left out.

    Raises: ParameterError for one that another process holds, and for a file that is none.
    """
    if path is None:
        yield RowCheckpoint({}, None)
        return
    need_room(path)
    if path.is_file():
        _repair(path)
    with path.open("ab+") as file:
        hold(path, file, HELD)
        file.seek(0)
        rows = dict(filter(None, map(_row, file)))
        yield RowCheckpoint(rows, file)


def _repair(path: Path) -> None:
    """Take damaged lines out of a checkpoint, at once or not at all."""
    with path.open("rb") as file:
        hold(path, file, HELD)
        lines = file.readlines()
        if lines and not any(_is_ours(line) for line in lines):
            raise ParameterError(
                f"{path}: is no checkpoint of a table of diagnoses; name another table with --table"
            )
        damaged = {number: line for number, line in enumerate(lines, 1) if _row(line) is None}
        set_aside(path, damaged, "its file is diagnosed")
        if damaged:
            kept = b"".join(line for line in lines if _row(line) is not None)
            write_whole(path, lambda whole: whole.write_bytes(kept))


def _is_ours(line: bytes) -> bool:
    """Whether a line is of a checkpoint, even if it is cut off."""
    return line.startswith(BEGIN) or BEGIN.startswith(line)


def _row(line: bytes) -> tuple[str, Row] | None:
    """Return key and row of a line; None where it is damaged."""
    try:
        record = json.loads(line)
        row = record["row"]
        key = record["femnl_row"]
        whole = line.endswith(b"\n") and row.keys() == failed("").keys()
        return (key, row) if whole and record["sum"] == _sum(key, row) else None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None


def _sum(key: str, row: Row) -> str:
    return hashlib.sha256(json_line({key: row})).hexdigest()[:16]
