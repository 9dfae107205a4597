"""The folder of kept results: what it holds, how large it may be, and what goes first."""

import logging
import os
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from platformdirs import user_cache_path

from femnl.core.errors import ParameterError

VARIABLE = "FEMNL_CACHE_GIB"
"""Of the environment: the most that results may take [GiB]."""
MOST = 4.0
"""GiB that results take unless the variable says otherwise."""
RESULTS = {
    "modes": "modes-*.nc",
    "nonlinearity": "nonlinearity-*.npz",
    "projections": "projection-*.npz",
}
"""Results, which are solved again where they are missing."""
CHECKPOINTS = "diagnosis-*.jsonl*"
"""Fits of diagnoses that were interrupted. They are small, and may be in use."""


@dataclass(frozen=True)
class Kept:
    """A file of the cache: its size [bytes], and when it was written or used last [s]."""

    path: Path
    size: int
    used: float


def folder() -> Path:
    """Return the folder of the cache, which may not be there."""
    return user_cache_path("femnl")


def limit() -> float:
    """Return how many bytes results may take.

    Raises: ParameterError for a variable that is no number.
    """
    text = os.environ.get(VARIABLE, "")
    try:
        size = float(text or MOST)
    except ValueError:
        size = -1.0
    if not size >= 0:
        raise ParameterError(
            f"{VARIABLE}={text}: expected a size in GiB, such as {MOST:g}; 0 keeps no result"
        )
    return size * 2**30


def listed() -> dict[str, list[Kept]]:
    """Return the files of the cache by what they hold."""
    patterns = RESULTS | {"checkpoints of diagnoses": CHECKPOINTS}
    return {name: _found(pattern) for name, pattern in patterns.items()}


def _found(pattern: str) -> list[Kept]:
    found = []
    for path in folder().glob(pattern):
        # Another process may remove it meanwhile
        with suppress(FileNotFoundError):
            about = path.stat()
            found.append(Kept(path, about.st_size, about.st_mtime))
    return found


def used(path: Path) -> None:
    """Note that a result is used now, so that it goes last."""
    with suppress(OSError):  # a cache that this user may only read stays as it is
        os.utime(path)


def trim(kept: Path) -> None:
    """Remove the results used least recently until the rest fits; never the one just kept.

    What is removed is told. Other processes may do the same, or read what goes: open files stay
    whole.
    """
    results = [result for pattern in RESULTS.values() for result in _found(pattern)]
    excess = sum(result.size for result in results) - limit()
    oldest = sorted((r for r in results if r.path != kept), key=lambda result: result.used)
    gone = []
    for result in oldest:
        if excess <= 0:
            break
        gone.append(result)
        excess -= result.size
    if remove(gone):
        logging.getLogger("femnl").warning(
            "the cache held more than %.3g GiB: removed %s used least recently (%s sets the limit)",
            limit() / 2**30,
            f"{len(gone)} result{'s' * (len(gone) > 1)}",
            VARIABLE,
        )


def remove(files: Iterable[Kept]) -> int:
    """Remove files of the cache; return how many bytes that freed.

    Raises: OSError where they may not be removed.
    """
    freed = 0
    for kept in files:
        # Another process may have removed it
        with suppress(FileNotFoundError):
            kept.path.unlink()
            freed += kept.size
    return freed
