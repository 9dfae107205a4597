"""TOML and other text of strangers: of bounded size and depth, from regular files only."""

import re
import tomllib
from collections.abc import Mapping
from errno import EINVAL
from itertools import chain
from pathlib import Path
from typing import Any

LARGEST = 2**24
"""Bytes of a file; a geometry with a list of the most holes allowed has a third of it."""
DEEPEST = 32
"""Tables within tables; what is shown of a value walks down into it."""
PART = r"""(?:(?<![\w-])[\w-]++|(?<!\\)"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""
LONG_KEY = re.compile(rf"(?<!\.)(?:{PART}[ \t]*+\.[ \t]*+){{{DEEPEST}}}", re.ASCII)
"""A key of more parts than that, for which tomllib takes memory by the square of their number."""


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a file.

    Raises: OSError for what cannot be read or is no regular file; ValueError, in a few words, for
    what is no TOML.
    """
    return parse_toml(read_text(path))


def read_text(path: Path) -> str:
    """Return the text of a file. Raises: as `read_toml`."""
    size = path.stat().st_size
    # A pipe would wait, and a device has no end
    if not path.is_file():
        raise OSError(EINVAL, "not a regular file", str(path))
    if size > LARGEST:
        raise ValueError(f"{size / 2**20:.0f} MiB, and such a file has at most {LARGEST / 2**20:g}")
    return path.read_text(encoding="utf-8-sig")  # editors on Windows put a mark first


def parse_toml(text: str) -> dict[str, Any]:
    """Return the tables of a text. Raises: ValueError, in a few words, for what is no TOML."""
    if LONG_KEY.search(text):
        raise ValueError("brackets or keys nested too deep")
    try:
        tables = tomllib.loads(text)
    except RecursionError:
        raise ValueError("brackets nested too deep") from None
    level: list[Any] = [tables]
    for _ in range(DEEPEST):
        level = list(chain.from_iterable(map(_within, level)))
    if level:
        raise ValueError("brackets or keys nested too deep")
    return tables


def _within(value: object) -> list[Any]:
    """Return what a table or a list holds."""
    if isinstance(value, Mapping):
        return list(value.values())
    return value if isinstance(value, list) else []
