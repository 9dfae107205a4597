"""One file of a table of diagnoses, which may be a lab file: what it needs, and its row.

`attempt` is what runs in other processes and on other machines.
"""

import hashlib
import logging
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Lock
from typing import Any

import numpy as np

from femnl.core.checkpoint import code_digest
from femnl.core.diagnosis import Diagnosis
from femnl.core.effect import Effect
from femnl.core.errors import FemnlError, one_line
from femnl.core.numbers import measured
from femnl.core.resources import find_geometry, geometries
from femnl.device.geometry import load
from femnl.diagnose.run import diagnose
from femnl.diagnose.sent import Sent, considered, received, sent
from femnl.effects import fingerprint
from femnl.io.labfiles import import_file, read_spec
from femnl.io.measurement import is_measurement, named_geometry
from femnl.pipeline import measured_device

Row = dict[str, Any]
"""verdict, causes, shares, p_value, gain, parameters, seconds and message of one file."""
FULL = "the memory is full; lower --workers or close other programs"

_ALONE = Lock()  # the mesher has one state a process, and a Dask worker may have several threads


@dataclass(frozen=True)
class Settings:
    """What all files of a table share.

    geometry: name of a shipped one, or name of a file of content `text`; None for that of each
    file. effects: as `femnl.diagnose.sent` returns them. digest: of all that rows depend on beside
    the files.
    """

    geometry: str | None
    text: str | None
    effects: tuple[Sent, ...]
    digest: str


@dataclass(frozen=True)
class Task:
    """A file to diagnose.

    path: as the user gave it. names: the file and others that it leans on, from the folder of the
    file. key: of these, by content, and of the settings. contents: of `names`, where the files may
    be out of reach; else they are read in their place.
    """

    path: Path
    names: tuple[str, ...]
    key: str
    contents: tuple[bytes, ...] = ()


def settings_of(geometry: str | Path | None, effects: Iterable[Effect] | None) -> Settings:
    """Return what all files share.

    Raises: GeometryError and ParameterError for what no file could be diagnosed with.
    """
    pool = considered(effects)
    name = None if geometry is None else str(geometry)
    text = None
    if name is not None:
        load(name)
        file = find_geometry(name)
        text = None if file.parent == geometries() else file.read_text(encoding="utf-8")
        name = file.stem if text is None else file.name
    # A file may name a shipped geometry, which is no code and may change without it
    shipped = [path.read_bytes() for path in sorted(geometries().glob("*.toml"))]
    about = (code_digest(), fingerprint(pool), name, text, shipped)
    digest = hashlib.sha256(repr(about).encode()).hexdigest()
    return Settings(name, text, tuple(sent(pool, workers=2)), digest)


def task_of(path: Path, settings: Settings) -> Task:
    """Return the task of a file; of one that cannot be read, too, which `attempt` will say."""
    try:
        names = (path.name, *_beside(path))
        digests = [_digest(path.parent / name) for name in names]
    except OSError:
        return Task(path, (path.name,), f"unread {path}")
    # What a lab file is, its name says
    named = () if _is_measurement(path) else (path.name,)
    content = repr((settings.digest, digests, names[1:], named))
    return Task(path, names, hashlib.sha256(content.encode()).hexdigest()[:32])


def loaded(task: Task) -> Task:
    """Return a task with the contents of its files, for a machine that may not have them."""
    try:
        contents = tuple((task.path.parent / name).read_bytes() for name in task.names)
    except OSError:  # which `attempt` says of that file
        return task
    return replace(task, contents=contents)


def attempt(task: Task, settings: Settings, folder: str | None = None) -> Row:
    """Diagnose one file, or say why that cannot be.

    Args: folder: where temporary files may be made.
    """
    began = time.perf_counter()
    with _ALONE, TemporaryDirectory(prefix="femnl-", dir=folder) as temporary:
        places = Places(task, settings, Path(temporary))
        try:
            row = _row(_diagnosed(task, settings, places))
        except FemnlError as error:
            row = failed(places.told(error))
        except MemoryError:
            row = failed(f"{task.path}: {FULL}")
        except OSError as error:
            row = failed(places.told(f"{error.filename or task.path}: {error.strerror or error}"))
        # A fault of femnl costs the row of this file, and no other
        except Exception as error:
            logging.getLogger("femnl").exception("%s", task.path)
            told = places.told(f"{type(error).__name__}: {error}")
            row = failed(f"{task.path}: a fault of femnl ({told}); please report it")
    return row | {"seconds": round(time.perf_counter() - began, 2)}


def failed(message: str) -> Row:
    """Return the row of a file that has no diagnosis."""
    return {
        "verdict": "",
        "causes": "",
        "shares": "",
        "p_value": float("nan"),
        "gain": float("nan"),
        "parameters": "",
        "seconds": float("nan"),
        "message": one_line(" ".join(message.split())),
    }


class Places:
    """Where the files of a task are while it is done.

    source: the file itself. imported: the measurement file that is made of a lab file. geometry:
    what `diagnose` takes.
    """

    def __init__(self, task: Task, settings: Settings, folder: Path) -> None:
        given = folder / "given"
        self.source = given / task.path.name if task.contents else task.path
        self.imported = folder / f"{task.path.stem}.nc"
        self.geometry = settings.geometry
        if settings.text is not None:
            self.geometry = str(folder / "geometry" / str(settings.geometry))
        self._original = {
            str(self.imported): str(task.path),
            f"{given}/": "" if task.path.parent == Path() else f"{task.path.parent}/",
            f"{folder / 'geometry'}/": "",
        }

    def told(self, error: Exception | str) -> str:
        """Return a message with the user's paths in the place of temporary ones."""
        message = str(error)
        for place, original in self._original.items():
            message = message.replace(place, original)
        return message


def _diagnosed(task: Task, settings: Settings, places: Places) -> Diagnosis:
    for name, content in zip(task.names, task.contents, strict=bool(task.contents)):
        _put(places.source.parent / name, content)
    geometry = places.geometry
    if geometry is not None and settings.text is not None:
        _put(Path(geometry), settings.text.encode())
    effects = [received(effect) for effect in settings.effects]
    if _is_measurement(places.source):
        return diagnose(places.source, geometry, effects)
    tree = import_file(places.source, places.imported)
    named = str(tree.attrs.get("geometry", ""))
    if geometry is None and named.endswith(".toml"):
        measured_device(tree.attrs, places.source)  # which refuses one of another folder
        geometry = str(places.source.parent / named)
    return diagnose(places.imported, geometry, effects)


def _is_measurement(path: Path) -> bool:
    """Whether a file is to be read as a measurement file; if it is not one, that is told."""
    return path.suffix.lower() == ".nc" or is_measurement(path)


def _put(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)


def _beside(path: Path) -> list[str]:
    """Return the files that a file leans on: a table of its columns, and a geometry.

    What cannot be read here is told where the file is diagnosed.
    """
    found = []
    named: str | None = None
    with suppress(FemnlError):
        if _is_measurement(path):
            named = named_geometry(path)
        elif (spec := path.with_suffix(".toml")).is_file():
            found.append(spec.name)
            named = read_spec(spec).geometry
    if named is not None and named.endswith(".toml") and _is_inside(path.parent, named):
        found.append(named)
    return list(dict.fromkeys(found))


def _is_inside(folder: Path, name: str) -> bool:
    """Whether a name leads to a file of a folder, as a measurement file may name its geometry."""
    file = (folder / name).resolve()
    return file.is_file() and file.is_relative_to(folder.resolve())


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _row(found: Diagnosis) -> Row:
    return {
        "verdict": found.verdict,
        "causes": " + ".join(found.causes),
        "shares": _shares(found),
        "p_value": float(found.p_value),
        "gain": float(found.gain),
        "parameters": _parameters(found),
        "seconds": np.nan,
        "message": "",
    }


def _shares(found: Diagnosis) -> str:
    """Return the part of the deviation that each cause takes up."""
    return "; ".join(f"{told.cause} {told.share:.6g}" for told in found.shares)


def _parameters(found: Diagnosis) -> str:
    """Return the parameters of the causes, then those of the base model, each with its sd."""
    listed = [
        (owner, parameter)
        for owner, own in sorted(found.parameters.items(), key=lambda item: item[0] == "base")
        for parameter in own.values()
    ]
    values = measured([p.value for _, p in listed], [p.sd for _, p in listed])
    texts = [
        f"{owner}.{parameter.name} = {value} {parameter.unit if parameter.unit != '1' else ''}"
        for (owner, parameter), value in zip(listed, values, strict=True)
    ]
    return "; ".join(text.rstrip() for text in texts)
