"""Folders beside a file, in which it is written before it takes its name."""

import fcntl
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

PREFIX = ".femnl-"
SETTLED = 1.0
"""Seconds after which a folder is locked by its writer, if that is alive."""


@contextmanager
def scratch(beside: Path) -> Iterator[Path]:
    """Make a folder that is gone after use, and remove those of writers that were killed.

    A writer holds a lock on its folder, which the system takes back when the writer ends.

    Args: beside: folder in which it is made. Raises: OSError where that is impossible.
    """
    _remove_abandoned(beside)
    with tempfile.TemporaryDirectory(prefix=PREFIX, dir=beside) as name:
        descriptor = os.open(name, os.O_RDONLY)
        try:
            with suppress(OSError):  # a disk without locks
                fcntl.flock(descriptor, fcntl.LOCK_EX)
            yield Path(name)
        finally:
            os.close(descriptor)


def _remove_abandoned(beside: Path) -> None:
    for folder in beside.glob(f"{PREFIX}*"):
        with suppress(OSError):  # its writer is at work, or has just ended
            if folder.is_symlink() or time.time() - folder.stat().st_mtime < SETTLED:
                continue
            descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder)
            finally:
                os.close(descriptor)
