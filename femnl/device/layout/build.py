"""A geometry file from a layout."""

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femnl.core.device import Model
from femnl.core.errors import GeometryError, ParameterError, one_line
from femnl.device.geometry import curves, parse
from femnl.device.geometry.naming import place
from femnl.device.layout.drawing import moved
from femnl.device.layout.metal import ALUMINIUM, parts_of
from femnl.device.layout.readers import read_drawing
from femnl.device.layout.recognise import outline_of
from femnl.device.layout.suspended import Film, film_of
from femnl.device.layout.tables import hole_groups, outline_keys, written

Array = NDArray[np.float64]
Tables = dict[str, Any]

TAKEN = ("film", "readout", "clamp", "model")
"""Tables that a layout does not draw, and another geometry lends."""


@dataclass(frozen=True)
class Imported:
    """A layout as a geometry file: its text and device, and what the import did.

    notes: one line each on what was recognised, moved, doubtful or assumed; assumed: those of them
    on numbers that a layout does not hold.
    """

    text: str
    model: Model
    notes: tuple[str, ...]
    assumed: tuple[str, ...] = ()


def import_layout(
    path: Path,
    layers: Mapping[str, str],
    like: Model,
    cell: str | None = None,
    unit: str | None = None,
    metal: Mapping[str, Any] | None = None,
) -> Imported:
    """Return the geometry file of a layout.

    Args:
        path: of a GDSII, OASIS, DXF or SVG file.
        layers: the layer of each of `drawing.ROLES`.
        like: a device with the film, readout, clamp and model that the layout does not draw.
        cell: the cell or block; where there is one top cell, that one.
        unit: of coordinates in a file that names none.
        metal: numbers of the layer `metal` by their keys; those of aluminium stand for others.

    Raises:
        ParameterError: numbers of a metal that `layers` does not name.
        GeometryError: a layout that cannot be read or that draws no film, and open paths or
            self-intersections: one line with the first coordinate.
    """
    metal = metal or {}
    if metal and "metal" not in layers:
        raise ParameterError("--metal gives numbers, and --layers no layer; add metal=5/0 to it")
    drawing = read_drawing(path, cell, layers, unit)
    try:
        film = film_of(drawing)
        x0, y0, x1, y1 = curves.box(outline_of(film.outer))
        half = drawing.grid / 2
        middle = np.round(np.array([x0 + x1, y0 + y1]) / 2 / half) * half
        tables: Tables = {
            "name": _plain(drawing.cell),
            "source": f"{path.name}, cell {drawing.cell}",
            "grid": written(drawing.grid),
            **_lent(like),
            "outline": outline_keys(moved(film.outer, -middle)),
        }
        groups = hole_groups(film.inner, middle, drawing.grid)
        shape = parts_of(film.metal, middle)
    except GeometryError as error:
        raise GeometryError(one_line(f"{path}: {error}")) from error
    if groups:
        tables["holes"] = groups
    if film.metal:
        tables["assumed"] += [f"layers.1.{key}" for key in _taken_for_metal(metal)]
        tables["layers"] = [{"name": "metal", **ALUMINIUM, **metal, "shape": shape}]
    text = toml(tables)
    model = parse(text, str(path))
    assumed = _assumed(film, like, metal)
    return Imported(text, model, (*_notes(film, middle, model), *assumed), assumed)


def toml(tables: Tables) -> str:
    """Return tables as TOML: values first, then each table, arrays of tables entry by entry."""
    lines = [f"{key} = {_value(v)}" for key, v in tables.items() if not _is_table(v)]
    for key, value in tables.items():
        if not _is_table(value):
            continue
        for entry in value if isinstance(value, list) else [value]:
            lines += ["", f"[[{key}]]" if isinstance(value, list) else f"[{key}]"]
            lines += [f"{name} = {_value(v)}" for name, v in entry.items()]
    return "\n".join(lines) + "\n"


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (
        isinstance(value, list) and bool(value) and isinstance(value[0], dict)
    )


def _value(value: Any) -> str:
    """A value in one line, long lists with an entry a line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        entries = [_value(v) for v in value]
        if any(isinstance(v, list | dict) for v in value) and len(entries) > 2:
            return "[\n  " + ",\n  ".join(entries) + ",\n]"
        return "[" + ", ".join(entries) + "]"
    return json.dumps(value, ensure_ascii=False)


def _key(key: str) -> str:
    bare = key.replace("_", "").replace("-", "")
    return key if bare.isalnum() and bare.isascii() else json.dumps(key)


def _lent(like: Model) -> Tables:
    """The tables of another geometry that a layout does not draw."""
    data = tomllib.loads(like.text)
    found = {key: data[key] for key in TAKEN if key in data}
    return {"assumed": ["film"], **found}


def _plain(name: str) -> str:
    """A cell's name as a geometry may have it."""
    kept = "".join(c if c.isalnum() or c in " .,+()_-" else "-" for c in name)[:100]
    return kept if kept[:1].isalnum() else f"cell {kept}"[:100]


def _taken_for_metal(metal: Mapping[str, Any]) -> list[str]:
    """The numbers of a layer that are taken for those of aluminium."""
    return [key for key in ALUMINIUM if key not in metal]


def _assumed(film: Film, like: Model, metal: Mapping[str, Any]) -> tuple[str, ...]:
    """What the import takes that the layout does not hold, a line each."""
    lent = f"film, readout and clamp are those of {like.name}; write your own into the file"
    taken = [f"{key} = {ALUMINIUM[key]}" for key in _taken_for_metal(metal)]
    if not film.metal or not taken:
        return (lent,)
    return (
        lent,
        f"the layer metal is taken for aluminium with {', '.join(taken)}; give your own with "
        "--metal, or write them into [[layers]]",
    )


def _notes(film: Film, middle: Array, model: Model) -> list[str]:
    """What the import did, a line each."""
    found = [f"recognised {count} {kind} drawn as chords" for kind, count in film.curves.items()]
    if np.any(middle != 0):
        found.append(f"the origin is now at {place(middle)} of the layout, the middle of the film")
    found += [f"doubtful: {fault}" for fault in film.faults[:10]]
    if len(film.faults) > 10:
        found.append(f"doubtful: {len(film.faults) - 10} more")
    inner = len(model.holes.centres) + len(model.openings)
    found.append(f"{model.outline.kind} with {len(model.outline.segments)} edges, {inner} holes")
    return found
