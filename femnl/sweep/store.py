"""The store of a sweep: a header and a line of JSON a point, each written before the next."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import IO, Annotated, Any, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from femnl.core.errors import ParameterError
from femnl.io.results.atomic import need_room, write_whole
from femnl.io.results.lines import append, hold, json_line, set_aside
from femnl.sweep.point import VERSION, Record, Settings

HELD = "another sweep is writing to this store; wait for it, or name another with --out"


Size = Annotated[float, Field(ge=0, le=2**60)]


class _Header(BaseModel):
    """The first line of a store."""

    model_config = ConfigDict(strict=True, extra="forbid")
    femnl_sweep: int
    settings: dict[str, Any]
    seed: Annotated[int, Field(ge=0, lt=2**63)]


class _Results(BaseModel):
    """Labels of the modes; every other column holds numbers, None for an unknown error."""

    model_config = ConfigDict(strict=True, extra="allow", allow_inf_nan=False)
    __pydantic_extra__: dict[str, list[float | None]]
    label: list[str]


class _Line(BaseModel):
    """A point that was solved, or one that failed."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)
    key: str
    varied: dict[str, Any]
    results: _Results | None = None
    error: str | None = None
    seconds: Size
    memory: Size

    @model_validator(mode="after")
    def _has_an_answer(self) -> Self:
        if (self.results is None) == (self.error is None):
            raise ValueError("neither results nor an error, or both")
        return self


class Store:
    """Records of solved and of failed points by their keys, open for more.

    One process at a time holds a store.
    """

    def __init__(
        self, path: Path, file: IO[bytes], settings: Settings, seed: int | None = None
    ) -> None:
        self.path = path
        self._file = file
        self._settings = settings
        header = self.reread()
        self.seed: int = header["seed"] if seed is None else seed

    def reread(self) -> dict[str, Any]:
        """Take the records from the disk, and return the header.

        An interrupt can come after a record was written and before `records` has it.
        """
        self._file.seek(0)
        header, lines = _read(self.path, self._file, self._settings)
        self._file.seek(0, os.SEEK_END)
        self.records: dict[str, Record] = {
            record["key"]: record for _, record in lines if record is not None
        }
        return header

    def add(self, record: Record) -> None:
        """Append a record and wait until the disk has it."""
        append(self._file, record)
        self.records[record["key"]] = record


@contextmanager
def open_store(path: Path, settings: Settings, seed: int | None, retry: bool) -> Iterator[Store]:
    """Open the store of a sweep, or begin one.

    A last line without its end, which a crash leaves, is cut off. Other damaged lines are told and
    set aside, and their points are solved anew. seed: of the sample, drawn and kept where None is
    given.
    retry: forget the points that failed.
    Raises: ParameterError for a store of other settings, one that another process holds, a file
    that is none, or none that can be.
    """
    need_room(path)
    if not path.exists():
        drawn = int(np.random.SeedSequence().generate_state(1)[0]) if seed is None else seed
        begin = {"femnl_sweep": VERSION, "settings": asdict(settings), "seed": drawn}
        write_whole(path, lambda file: file.write_bytes(json_line(begin)))
    else:
        _mend(path, settings, retry)
    with path.open("rb+") as file:
        hold(path, file, HELD)
        yield Store(path, file, settings, seed)


def _mend(path: Path, settings: Settings, retry: bool) -> None:
    """Leave damaged lines out of a store, and where asked failed points, at once or not at all."""
    with path.open("rb") as file:
        hold(path, file, HELD)
        header, lines = _read(path, file, settings)
        damaged = {at: line for at, (line, record) in enumerate(lines, 2) if record is None}
        torn = {at: line for at, line in damaged.items() if not line.endswith(b"\n")}
        set_aside(
            path,
            {at: line for at, line in damaged.items() if at not in torn},
            "its point is solved",
        )
        records = [record for _, record in lines if record is not None]
        kept = [record for record in records if not (retry and "error" in record)]
        if damaged or len(kept) < len(records):
            content = b"".join(map(json_line, [header, *kept]))
            write_whole(path, lambda whole: whole.write_bytes(content))


def _read(
    path: Path, file: IO[bytes], settings: Settings
) -> tuple[dict[str, Any], list[tuple[bytes, Record | None]]]:
    """Return the header, and every other line with its record, None where it is damaged."""
    header = _parsed(file.readline(), _Header)
    if header is None:
        raise ParameterError(f"{path}: is no store of a sweep; name another with --out")
    _refuse_others(path, header, settings)
    return header, [(line, _record(line, settings)) for line in file]


def _record(line: bytes, settings: Settings) -> Record | None:
    """Return the record of a line; None where it is damaged."""
    record = _parsed(line, _Line)
    if record is None or "error" in record:
        return record
    names = ("label", *(name for kept in settings.keep for name in (kept, f"{kept}_error")))
    results = record["results"]
    whole = results.keys() == set(names) and all(
        len(column) == settings.modes for column in results.values()
    )
    return record if whole else None


def _parsed(line: bytes, form: type[BaseModel]) -> dict[str, Any] | None:
    """Return the object of a line, as it was written; None for what is none of this form."""
    try:
        found: dict[str, Any] = json.loads(line)
        form.model_validate(found)
    except (ValueError, RecursionError):  # the latter of a bracket in a bracket, and so on
        return None
    return found if line.endswith(b"\n") else None


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
