"""From a geometry's name, file or text to a Model."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from femnl.core import resources
from femnl.core.device import Model
from femnl.core.errors import GeometryError, one_line
from femnl.core.outline import Holes, Outline
from femnl.core.toml import parse_toml
from femnl.device.geometry import curves
from femnl.device.geometry.schema import GeometryFile
from femnl.device.geometry.tables import complaint


@dataclass(frozen=True)
class Sketch:
    """What a geometry draws.

    outline (n, 2) [m]: points along it, closed, or its corners where it cannot be made; faults:
    what is wrong with it.
    """

    outline: NDArray[np.float64]
    holes: Holes
    openings: tuple[Outline, ...]
    faults: tuple[GeometryError, ...]


LARGEST = 2**24
"""Bytes of a geometry file; a list of the most holes allowed has a third of it."""


def load(name_or_path: str | Path) -> Model:
    """Read a device from a shipped geometry or from a TOML file.

    Args:
        name_or_path: a name that `shipped` lists, or else the path of a file.

    Raises:
        GeometryError: no such geometry, or a file that does not describe a device: one line with
            file, key, value and remedy.
    """
    path = resources.find_geometry(name_or_path)
    return parse(read_text(path), str(path))


def load_shipped(name: str) -> Model:
    """Read a shipped geometry by its name, and never a file elsewhere.

    Raises:
        GeometryError: no such geometry.
    """
    path = resources.find_shipped(name)
    return parse(read_text(path), str(path))


def parse(text: str, origin: str = "geometry") -> Model:
    """Read a device from TOML text.

    Args:
        text: the content of a geometry file.
        origin: what messages call it, usually a path.

    Raises:
        GeometryError: text that does not describe a device: one line with origin, key, value and
            remedy.
    """
    try:
        data = _toml(text)
        model = replace(GeometryFile.model_validate(data).build(text), reader=parse)
        _refuse_unknown_assumptions(data, model.assumed)
    except ValidationError as error:
        raise GeometryError(f"{one_line(origin)}: {complaint(error)}") from None
    except GeometryError as error:
        line = f"{one_line(origin)}: {one_line(str(error))}"
        raise GeometryError(line, error.point) from None
    return model


def sketch(text: str, origin: str) -> Sketch:
    """Read what a geometry draws, whatever is wrong with where it lies.

    Raises:
        GeometryError: text that draws nothing.
    """
    try:
        tables = GeometryFile.model_validate(_toml(text))
        holes, inner = tables.inner()
    except ValidationError as error:
        raise GeometryError(f"{one_line(origin)}: {complaint(error)}") from None
    except GeometryError as error:
        raise GeometryError(f"{one_line(origin)}: {one_line(str(error))}") from None
    try:
        faults = tuple(tables.faults(holes, inner))
        outline = curves.polyline(tables.outline.outline(holes))
    except GeometryError as error:
        faults = (error,)
        corners = np.array(getattr(tables.outline, "points", np.empty((0, 2))))
        outline = np.concatenate([corners, corners[:1]])
    return Sketch(outline, holes, inner.rims, faults)


def describe(model: Model) -> str:
    """Describe a device in one line."""
    n = len(model.holes.centres)
    film = model.film
    size = model.outline.size if model.outline.kind == "rectangle" else None
    extent = (
        f"{size[0] * 1e6:.5g} × {size[1] * 1e6:.5g} µm"
        if size
        else f"{model.outline.length * 1e6:.5g} µm"
    )
    holes = (
        f"{n} hole{'s' * (n > 1)} of radius {model.holes.radius * 1e6:.4g} µm" if n else "no holes"
    )
    if model.openings:
        m = len(model.openings)
        holes = f"{holes if n else ''}{' and ' if n else ''}{m} opening{'s' * (m > 1)}"
    held = "" if model.clamp.rigid else ", elastic clamp"
    if model.layers:
        held = f", layers {', '.join(lamina.name for lamina in model.layers)}{held}"
    if model.overhang is not None:
        held = f", overhang {model.overhang.width * 1e6:.4g} µm{held}"
    return (
        f"{model.outline.kind}, {extent}, {holes}, film {film.thickness * 1e9:.5g} nm at "
        f"{film.stress / 1e6:.5g} MPa{held}"
    )


def read_text(path: Path) -> str:
    """Return the text of a geometry file.

    Raises:
        GeometryError: a file that cannot be read or is no text.
    """
    try:
        if path.exists() and not path.is_file():
            raise GeometryError(
                one_line(f"{path}: not a regular file; give a shipped name or a TOML file")
            )
        size = path.stat().st_size
        if size > LARGEST:
            raise GeometryError(
                one_line(
                    f"{path}: {size / 2**20:.0f} MiB, and a geometry has at most "
                    f"{LARGEST / 2**20:g}; check the path"
                )
            )
        text = path.read_text(encoding="utf-8-sig")  # editors on Windows put a mark first
    except OSError as error:
        raise GeometryError(
            one_line(
                f"{path}: cannot be read: {error.strerror}; give a shipped name or a TOML file"
            )
        ) from error
    except UnicodeDecodeError as error:
        raise GeometryError(
            one_line(f"{path}: not a geometry, a TOML file ({error.reason} at byte {error.start})")
        ) from error
    return text


def _toml(text: str) -> dict[str, Any]:
    try:
        return parse_toml(text)
    except ValueError as error:  # tomllib's own, and Python's for integers of thousands of digits
        raise GeometryError(
            f"not TOML: {str(error).split(';')[0]}; text and quantities stand in quotes"
        ) from error


def _refuse_unknown_assumptions(data: dict[str, Any], assumed: tuple[str, ...]) -> None:
    for name in assumed:
        value: Any = data
        for key in name.split("."):
            # Groups of holes, points and layers are counted from 1
            if isinstance(value, list) and key.isdecimal() and 1 <= int(key) <= len(value):
                value = value[int(key) - 1]
                continue
            if not isinstance(value, dict) or key not in value:
                raise GeometryError(
                    f'assumed = "{name}": no such value in this file, write e.g. "film.thickness"'
                )
            value = value[key]
