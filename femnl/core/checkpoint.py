"""Finished fits of a diagnosis on disk, so that an interrupted one goes on where it stopped."""

import hashlib
import json
import logging
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from platformdirs import user_cache_path

from femnl.core.readout import Array

WARNINGS = logging.getLogger("femnl")
Found = tuple[Array, Array]


class Checkpoint:
    """A file of one line a fit, only ever added to; it is removed when the diagnosis is done.

    known: fits by their keys, as the file held them.
    """

    def __init__(self, path: Path, known: dict[str, Found]) -> None:
        self.path = path
        self._known = known
        self._writable = True

    def recall(self, key: str, find: Callable[[], Found]) -> Found:
        """Return what was kept under a key, or find it and keep it.

        Numbers come back as they were, to the last bit.
        """
        if key not in self._known:
            self.add(key, find())
        return self._known[key]

    def add(self, key: str, found: Found) -> None:
        """Keep a fit: a line more."""
        self._known[key] = found
        if not self._writable:
            return
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("ab") as file:
                file.write(_line(key, found))
        except OSError as error:
            self._writable = False
            WARNINGS.warning(
                "%s: fits are not kept (%s); an interrupted diagnosis would start anew",
                self.path,
                error,
            )

    def close(self) -> None:
        """Remove the file: all is done."""
        try:
            if self.path.is_file():
                self.path.unlink()
        except OSError as error:
            WARNINGS.warning(
                "%s: cannot be removed (%s), though it is needed no longer", self.path, error
            )


class Share(Checkpoint):
    """What a helper knows of a checkpoint, and adds to it.

    The process that owns the file writes that.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, dict(filter(None, map(_fit, _lines(path)))))
        self._added: list[tuple[str, Found]] = []

    def add(self, key: str, found: Found) -> None:
        """Keep a fit until it is taken."""
        self._known[key] = found
        self._added.append((key, found))

    def taken(self) -> list[tuple[str, Found]]:
        """Hand over what was added since."""
        added = self._added
        self._added = []
        return added


@contextmanager
def remembered(*about: object) -> Iterator[Checkpoint]:
    """Keep fits, under what they depend on beside this code, until all within are done.

    What an interruption leaves is found by the same call again.
    """
    digest = hashlib.sha256(repr((code_digest(), *about)).encode()).hexdigest()[:32]
    checkpoint = open_checkpoint(user_cache_path("femnl") / f"diagnosis-{digest}.jsonl")
    yield checkpoint
    checkpoint.close()


def open_checkpoint(path: Path) -> Checkpoint:
    """Go on with the fits of an earlier run, or begin anew.

    A last line without its end, which a kill leaves, is cut off. Where another line is not as it
    was written, that is told, the file is set aside, and the fit of that line is made anew.
    """
    lines = _lines(path)
    fits = list(map(_fit, lines))
    known = dict(filter(None, fits))
    damaged = [number for number, fit in enumerate(fits, 1) if fit is None]
    checkpoint = Checkpoint(path, known)
    edited = bool(damaged) and lines[damaged[0] - 1].endswith(b"\n")
    if damaged:
        _repair(path, [_line(key, found) for key, found in known.items()], aside=edited)
    if edited:
        WARNINGS.warning(
            "%s: %d of %d lines are damaged, the first of them line %d; the file is set aside as "
            "%s, and these fits are made anew",
            path,
            len(damaged),
            len(lines),
            damaged[0],
            _aside(path).name,
        )
    if known:
        logging.getLogger("femnl.progress").info(
            "going on after %d fits of an earlier run", len(known)
        )
    return checkpoint


def _aside(path: Path) -> Path:
    return path.with_name(f"{path.name}.damaged")


def _repair(path: Path, whole: list[bytes], *, aside: bool) -> None:
    """Leave only whole lines in a checkpoint.

    Args: aside: whether the file as it was is kept beside it.
    """
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        part.write_bytes(b"".join(whole))
        if aside:
            path.replace(_aside(path))
        part.replace(path)
    except OSError as error:
        WARNINGS.warning("%s: cannot be repaired (%s); its whole lines are used", path, error)


def _lines(path: Path) -> list[bytes]:
    return path.read_bytes().splitlines(keepends=True) if path.is_file() else []


def _line(key: str, found: Found) -> bytes:
    """Return a fit as a line that ends in a checksum of the rest."""
    fit = [key, *(values.tolist() for values in found)]
    return json.dumps([*fit, _sum(fit)]).encode() + b"\n"


def _fit(line: bytes) -> tuple[str, Found] | None:
    """Return key and fit of a line; None where it is not as it was written."""
    try:
        *fit, checksum = json.loads(line)
        key, vector, steps = fit
        found = np.array(vector, float), np.array(steps, float)
    except (ValueError, TypeError, RecursionError):
        return None
    return (key, found) if line.endswith(b"\n") and checksum == _sum(fit) else None


def _sum(fit: list[Any]) -> str:
    return hashlib.sha256(json.dumps(fit).encode()).hexdigest()[:16]


@cache
def code_digest() -> str:
    """Return a digest of all source, so that a change of code never meets an old result."""
    return hashlib.sha256(
        b"".join(file.read_bytes() for file in sorted(Path(__file__).parents[1].rglob("*.py")))
    ).hexdigest()
