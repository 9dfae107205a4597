"""Finished fits of a diagnosis on disk, so that an interrupted one goes on where it stopped."""

import hashlib
import json
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy as np
from platformdirs import user_cache_path

from femnl.core.readout import Array

WARNINGS = logging.getLogger("femnl")
Found = tuple[Array, Array]


class Checkpoint:
    """A file of one line a fit, only ever added to; it is removed when the diagnosis is done."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._known: dict[str, Found] = {}
        self._writable = True
        text = path.read_text(encoding="utf-8") if path.is_file() else ""
        # Of a torn line, which must not tear the next one, too
        self._end = "" if text.endswith("\n") or not text else "\n"
        for line in text.splitlines():
            try:
                key, vector, steps = json.loads(line)
                self._known[key] = np.array(vector, float), np.array(steps, float)
            except (ValueError, TypeError):
                continue  # torn by what ended the earlier run; that fit is made again
        if self._known:
            logging.getLogger("femnl.progress").info(
                "going on after %d fits of an earlier run", len(self._known)
            )

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
        line = json.dumps([key, *(values.tolist() for values in found)]) + "\n"
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("a", encoding="utf-8") as file:
                file.write(self._end + line)
                self._end = ""
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
        super().__init__(path)
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
    checkpoint = Checkpoint(user_cache_path("femnl") / f"diagnosis-{digest}.jsonl")
    yield checkpoint
    checkpoint.close()


@cache
def code_digest() -> str:
    """Return a digest of all source, so that a change of code never meets an old result."""
    return hashlib.sha256(
        b"".join(file.read_bytes() for file in sorted(Path(__file__).parents[1].rglob("*.py")))
    ).hexdigest()
