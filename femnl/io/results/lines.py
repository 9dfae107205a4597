"""Files of one JSON object a line, only ever added to, which one process at a time holds."""

import fcntl
import json
import logging
import os
from collections.abc import Mapping
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


def set_aside(path: Path, damaged: Mapping[int, bytes], remedy: str) -> None:
    """Keep damaged lines, by their numbers, in a file of their own, and tell each of them."""
    if not damaged:
        return
    aside = path.with_name(f"{path.name}.damaged")
    for number in damaged:
        logging.getLogger("femnl").warning(
            "%s: line %d is damaged and set aside in %s; %s anew", path, number, aside, remedy
        )
    with aside.open("ab") as file:
        file.writelines(line if line.endswith(b"\n") else line + b"\n" for line in damaged.values())


def append(file: IO[bytes], record: dict[str, Any]) -> None:
    """Add a line, and wait until the disk has it."""
    file.write(json_line(record))
    file.flush()
    os.fsync(file.fileno())


def json_line(record: dict[str, Any]) -> bytes:
    """Return an object as a line."""
    return json.dumps(record, ensure_ascii=False).encode() + b"\n"
