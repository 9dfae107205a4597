"""The store of a sweep: a header and a line of JSON a point, each written before the next."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import IO, Any

import numpy as np

from femnl.core.errors import ParameterError
from femnl.io.results.atomic import need_room, write_whole
from femnl.io.results.lines import append, hold, json_line
from femnl.sweep.point import VERSION, Record, Settings

HELD = "another sweep is writing to this store; wait for it, or name another with --out"


class Store:
    """Records of solved and of failed points by their keys, open for more.

    One process at a time holds a store.
    """

    def __init__(self, path: Path, file: IO[bytes], seed: int, records: dict[str, Record]) -> None:
        self.path = path
        self.seed = seed
        self.records = records
        self._file = file

    def add(self, record: Record) -> None:
        """Append a record and wait until the disk has it."""
        append(self._file, record)
        self.records[record["key"]] = record


@contextmanager
def open_store(path: Path, settings: Settings, seed: int | None, retry: bool) -> Iterator[Store]:
    """Open the store of a sweep, or begin one.

    A last line without its end, which a crash leaves, is cut off. seed: of the sample, drawn and
    kept where None is given.
    retry: forget the points that failed.
    Raises: ParameterError for a store of other settings, one that another process holds, one that
    is damaged, or none that can be.
    """
    need_room(path)
    if not path.exists():
        drawn = int(np.random.SeedSequence().generate_state(1)[0]) if seed is None else seed
        begin = {"femnl_sweep": VERSION, "settings": asdict(settings), "seed": drawn}
        write_whole(path, lambda file: file.write_bytes(json_line(begin)))
    elif retry:
        _forget_failures(path)
    with path.open("rb+") as file:
        hold(path, file, HELD)
        header, records, end = _read(path, file)
        _refuse_others(path, header, settings)
        file.truncate(end)
        file.seek(end)
        yield Store(path, file, header["seed"] if seed is None else seed, records)


def _read(path: Path, file: IO[bytes]) -> tuple[dict[str, Any], dict[str, Record], int]:
    """The header, the records, and the place where the last whole line ends."""
    header: dict[str, Any] | None = None
    records: dict[str, Record] = {}
    end = 0
    for number, line in enumerate(file, 1):
        if not line.endswith(b"\n"):
            break
        try:
            record = json.loads(line)
            if header is None:
                header = {
                    "femnl_sweep": record["femnl_sweep"],
                    "settings": record["settings"],
                    "seed": int(record["seed"]),
                }
            else:
                records[record["key"]] = record
        except (ValueError, KeyError, TypeError):
            remedy = (
                "take that line out, and its point is solved anew"
                if header
                else "this is no store of a sweep; name another with --out"
            )
            raise ParameterError(f"{path}: line {number} cannot be read; {remedy}") from None
        end += len(line)
    if header is None:
        raise ParameterError(f"{path}: is no store of a sweep; name another with --out")
    return header, records, end


def _refuse_others(path: Path, header: dict[str, Any], settings: Settings) -> None:
    """Points solved differently never meet in one store."""
    if header["femnl_sweep"] != VERSION:
        raise ParameterError(
            f"{path}: solved by version {header['femnl_sweep']} of sweeps, and this is {VERSION}; "
            "name another store with --out"
        )
    asked = json.loads(json.dumps(asdict(settings)))
    for name, value in asked.items():
        if header["settings"].get(name) != value:
            raise ParameterError(
                f"{path}: was solved with {name} = {json.dumps(header['settings'].get(name))} and "
                f"not {json.dumps(value)}; set it back, or name another store with --out"
            )


def _forget_failures(path: Path) -> None:
    """Leave failed points out of a store, at once or not at all."""
    with path.open("rb") as file:
        hold(path, file, HELD)
        header, records, _ = _read(path, file)
        kept = [record for record in records.values() if "error" not in record]
        if len(kept) < len(records):
            write_whole(
                path, lambda whole: whole.write_bytes(b"".join(map(json_line, [header, *kept])))
            )
