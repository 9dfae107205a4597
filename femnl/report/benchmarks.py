"""Benchmarks on the page: what `make benchmarks` kept, each with its machine and its load."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from femnl.core.numbers import plain

NAME = "benchmarks.json"
"""File of the benchmarks beside the validation cases."""
DIGITS = 3
BUSY = 0.3
"""Processes that wait or run, on average over a minute, from which on something else runs."""


@dataclass(frozen=True)
class Benchmark:
    """A benchmark as words and tables of text: each a head and rows."""

    name: str
    caption: str
    words: str
    tables: list[tuple[list[str], list[list[str]]]]


def benchmarks(folder: Path) -> list[Benchmark]:
    """Read what was kept beside the validation cases; nothing where there is none."""
    path = folder / NAME
    if not path.is_file():
        return []
    kept = json.loads(path.read_text(encoding="utf-8"))
    return [
        Benchmark(
            name,
            found["caption"],
            _words(found),
            [(t["head"], [[*map(_cell, row)] for row in t["rows"]]) for t in found["tables"]],
        )
        for name, found in kept.items()
    ]


def _words(found: Mapping[str, Any]) -> str:
    seconds, used, load = (
        plain(found[key], DIGITS) for key in ("seconds", "cpu_seconds", "load_before")
    )
    beside = "beside other programs" if found["load_before"] > BUSY else "on an idle machine"
    return (
        f"{found['command']}, {found['date']}: {seconds} s {beside} (load {load} before it), "
        f"{used} s of processor time in all processes; {found['processor']}, {found['system']}, "
        f"{found['threads']}."
    )


def _cell(cell: str | float | None) -> str:
    if cell is None:
        return "–"
    return cell if isinstance(cell, str) else plain(cell, DIGITS)
