"""From a geometry's name, file or text to a Model."""

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from femnl.core import resources
from femnl.core.device import Model
from femnl.core.errors import GeometryError, one_line
from femnl.core.toml import parse_toml
from femnl.device.geometry.schema import GeometryFile
from femnl.device.geometry.tables import complaint

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
    return _read(resources.find_geometry(name_or_path))


def load_shipped(name: str) -> Model:
    """Read a shipped geometry by its name, and never a file elsewhere.

    Raises:
        GeometryError: no such geometry.
    """
    return _read(resources.find_shipped(name))


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
        model = GeometryFile.model_validate(data).build(text)
        _refuse_unknown_assumptions(data, model.assumed)
    except ValidationError as error:
        raise GeometryError(f"{one_line(origin)}: {complaint(error)}") from None
    except GeometryError as error:
        raise GeometryError(f"{one_line(origin)}: {one_line(str(error))}") from None
    return model


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
    if model.overhang is not None:
        held = f", overhang {model.overhang.width * 1e6:.4g} µm{held}"
    return (
        f"{model.outline.kind}, {extent}, {holes}, film {film.thickness * 1e9:.5g} nm at "
        f"{film.stress / 1e6:.5g} MPa{held}"
    )


def _read(path: Path) -> Model:
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
            one_line(f"{path}: not text in UTF-8: {error.reason} at byte {error.start}")
        ) from error
    return parse(text, str(path))


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
