"""The text of a geometry file with other values in it, and whether two devices are the same."""

import json
import tomllib
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
import tomlkit
from tomlkit.exceptions import TOMLKitError

from femnl.core.errors import GeometryError

FILM = {
    "thickness": "m",
    "young": "Pa",
    "poisson": None,
    "density": "kg/m^3",
    "stress": "Pa",
    "taper": "m",
    "taper_length": "m",
}
"""Numbers of a film in a geometry file, and their units; None for a plain number."""


def film_values(film: Any) -> dict[str, object]:
    """Return the numbers of a film as a geometry file has them, by key; those that are 0 left out.

    Args: film: a `femnl.core.device.Film`.
    """
    found: dict[str, object] = {}
    for name, unit in FILM.items():
        value = float(getattr(film, name))
        if value:
            found[f"film.{name}"] = value if unit is None else f"{value!r} {unit}"
    return found


def same(one: Any, other: Any) -> bool:
    """Whether two values of a device are the same, arrays within them too."""
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other)
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if hasattr(one, "__dataclass_fields__"):
        return type(one) is type(other) and all(
            same(getattr(one, part.name), getattr(other, part.name)) for part in fields(one)
        )
    return bool(one == other)


def with_values(text: str, values: Mapping[str, object], name: str) -> str:
    """Return the text of a geometry with other values; a sweep writes its geometries as JSON.

    Args: text: TOML, or JSON. values: by dotted key, as "film.stress"; groups of holes, points and
        layers are counted from 1. name: of the device, for messages.
    Raises: GeometryError for a key that leads nowhere, and for a value that TOML cannot hold.
    """
    if text.lstrip().startswith("{"):
        tables = json.loads(text)
        for key, value in values.items():
            _put(tables, key, value, name)
        return json.dumps(tables, ensure_ascii=False)
    document = tomlkit.parse(text)
    try:
        for key, value in values.items():
            _put(document, key, value, name)
        written = tomlkit.dumps(document)
        tomllib.loads(written)
    except (TOMLKitError, ValueError, TypeError) as error:
        raise GeometryError(
            f"{name}: {', '.join(values)}: cannot be written as TOML ({error}); give text, a "
            "number, true or false, or a list of them"
        ) from None
    return written


def without_layers(text: str) -> str:
    """Return the text of a geometry file without its layers.

    What was assumed of them is assumed of the film.
    """
    document = tomlkit.parse(text)
    document.remove("layers")
    assumed = [str(key) for key in document.get("assumed", [])]
    kept = [key for key in assumed if key.split(".")[0] != "layers"]
    if len(kept) < len(assumed):
        document["assumed"] = sorted({*kept, "film"})
    return tomlkit.dumps(document)


def _put(tables: Any, key: str, value: object, name: str) -> None:
    """Set the value at a dotted key; tables that the text leaves out are begun."""
    *way, last = key.split(".")
    here = tables
    for part in way:
        if isinstance(here, list) and part.isdecimal() and 1 <= int(part) <= len(here):
            here = here[int(part) - 1]
        elif isinstance(here, dict) and isinstance(here.get(part, {}), dict | list):
            here = here.setdefault(part, {})
        else:
            raise _no_such_value(key, name)
    if isinstance(here, list) and last.isdecimal() and 1 <= int(last) <= len(here):
        here[int(last) - 1] = value
    elif isinstance(here, dict) and last:
        here[last] = value
    else:
        raise _no_such_value(key, name)


def _no_such_value(key: str, name: str) -> GeometryError:
    return GeometryError(f"{name}: has no value '{key}'; write e.g. 'film.stress'")
