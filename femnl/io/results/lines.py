"""Files of one JSON object a line, only ever added to, which one process at a time holds."""

import fcntl
import json
import os
from pathlib import Path
from typing import IO, Any

from femnl.core.errors import ParameterError


def hold(path: Path, file: IO[bytes], remedy: str) -> None:
    """Keep an open file for this process until it is closed.

    Raises: ParameterError, with the remedy, where another process holds it.
    """
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise ParameterError(f"{path}: {remedy}") from None


def append(file: IO[bytes], record: dict[str, Any]) -> None:
    """Add a line, and wait until the disk has it."""
    file.write(json_line(record))
    file.flush()
    os.fsync(file.fileno())


def json_line(record: dict[str, Any]) -> bytes:
    """Return an object as a line."""
    return json.dumps(record, ensure_ascii=False).encode() + b"\n"
