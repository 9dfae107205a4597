"""Gwyddion's own files (.gwy): images of one extent as the harmonic of a map.

The bytes "GWYP", then one object, low bytes first. An object is the name of its type, ended by NUL,
the size of what follows as a 32-bit number, and components: a name ended by NUL, a letter for the
type, and the value. Letters: b and c a byte, i 32 bits, q 64 bits, d a double, s text ended by NUL,
o an object; capitals are arrays, which begin with their number of items as a 32-bit number.
The container has the image N as the object "/N/data" of type GwyDataField and its title as the text
"/N/data/title". A field has xres, yres, xreal, yreal, xoff, yoff (of the upper left corner), the
units si_unit_xy and si_unit_z, objects with a text unitstr, and data, row by row from the top.

Images are columns by their title in the TOML beside the file, x and y the centres of pixels; rows
run downwards and femnl's y upwards. Values are in the unit of their image. Source: Gwyddion user
guide, "Gwyddion Native Data Format" (gwyddion.net/documentation/user-guide-en/gwyfile-format.html).
"""

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io.labfiles.base import Format, Groups, head, need_size
from femnl.io.labfiles.columns import one_table
from femnl.io.labfiles.named_columns import in_own_units, named
from femnl.io.labfiles.spec import Spec

START = b"GWYP"
SIZES: Mapping[str, int] = {"b": 1, "c": 1, "i": 4, "q": 8, "d": 8}
"""Bytes of a value, and of an item of an array, by the letter of its type."""
IMAGE = re.compile(r"/(\d+)/data")


@dataclass(frozen=True)
class Component:
    """Where the value of a component lies: bytes begin … end − 1; kind: the letter of its type."""

    kind: str
    begin: int
    end: int


@dataclass(frozen=True, eq=False)
class Image:
    """One image: width and height, left and top edge in `xy_unit`; rows (n_y, n_x) from the top."""

    size: tuple[float, float]
    corner: tuple[float, float]
    xy_unit: str
    unit: str
    rows: NDArray[np.float64]


def _read(paths: Sequence[Path], spec: Spec) -> tuple[Groups, list[str]]:
    path = paths[0]
    need_size(path, "save the images that are needed alone")
    images = _images(path.read_bytes(), path)
    wanted = [name for name in images if name in named(spec)] or list(images)
    first = images[wanted[0]]
    for name in wanted[1:]:
        if not _alike(images[name], first):
            raise MeasurementError(
                f"{path}: image {name!r} does not lie where {wanted[0]!r} does; crop both alike"
            )
    units = {"x": first.xy_unit, "y": first.xy_unit}
    units |= {name: images[name].unit for name in wanted}
    table = _table(first, {name: images[name].rows for name in wanted})
    return one_table(paths, in_own_units(spec, units), "Gwyddion file", lambda _: table)


def _alike(one: Image, other: Image) -> bool:
    """Whether two images have the same pixels."""
    same = one.rows.shape == other.rows.shape and one.xy_unit == other.xy_unit
    apart = 1e-6 * np.abs([one.size, other.size]).max()
    return same and np.allclose(
        [one.size, one.corner], [other.size, other.corner], rtol=0, atol=apart
    )


def _table(first: Image, rows: Mapping[str, NDArray[np.float64]]) -> dict[str, NDArray[Any]]:
    """Return x and y of every pixel, and the images, each as a column (n_x n_y,)."""
    n_y, n_x = first.rows.shape
    x = first.corner[0] + (np.arange(n_x) + 0.5) * first.size[0] / n_x
    y = -(first.corner[1] + (np.arange(n_y) + 0.5) * first.size[1] / n_y)
    columns = {name: image.ravel() for name, image in rows.items()}
    return {"x": np.tile(x, n_y), "y": np.repeat(y, n_x), **columns}


def _images(data: bytes, path: Path) -> dict[str, Image]:
    """Return the images by title, or by number where they have none. Raises: MeasurementError."""
    _, top = _object(data, len(START), len(data), path)
    found: dict[str, Image] = {}
    for name, component in top.items():
        match = IMAGE.fullmatch(name)
        if match is None or component.kind != "o":
            continue
        kind, field = _object(data, component.begin, component.end, path)
        if kind != "GwyDataField":
            continue
        title = _text(data, top.get(f"{name}/title"), match[1])
        if title in found:
            raise MeasurementError(
                f"{path}: two images are called {title!r}; rename one in Gwyddion"
            )
        found[title] = _image(data, field, f"{path}: image {title!r}", path)
    if not found:
        raise MeasurementError(f"{path}: holds no image; save one")
    return found


def _image(data: bytes, field: Mapping[str, Component], where: str, path: Path) -> Image:
    """Return the image that the components of a field make. Raises: MeasurementError."""
    n_x, n_y = (_number(data, field, name, "i", where) for name in ("xres", "yres"))
    width, height = (_number(data, field, name, "d", where) for name in ("xreal", "yreal"))
    left, top = (
        _number(data, field, name, "d", where) if name in field else 0.0
        for name in ("xoff", "yoff")
    )
    values = field.get("data")
    if values is None or values.kind != "D" or n_x < 1 or n_y < 1:
        raise MeasurementError(f"{where}: has no pixels; save it again")
    count = (values.end - values.begin - 4) // SIZES["d"]
    if count != n_x * n_y:
        raise MeasurementError(
            f"{where}: {count} values where {n_x:g} × {n_y:g} pixels need {n_x * n_y:g}; save it "
            "again"
        )
    rows = np.frombuffer(data, "<f8", count, values.begin + 4).reshape(int(n_y), int(n_x))
    xy_unit = _unit(data, field.get("si_unit_xy"), "m", path)
    unit = _unit(data, field.get("si_unit_z"), "V", path)
    return Image((width, height), (left, top), xy_unit, unit, rows.astype(float))


def _number(data: bytes, field: Mapping[str, Component], name: str, kind: str, where: str) -> float:
    """Return a finite number of a field. Raises: MeasurementError where it has none."""
    component = field.get(name)
    if component is None or component.kind != kind:
        raise MeasurementError(f"{where}: {name} is missing; save it again")
    value = float(struct.unpack_from(f"<{kind}", data, component.begin)[0])
    if not np.isfinite(value):
        raise MeasurementError(f"{where}: {name} = {value:g}: must be finite; save it again")
    return value


def _unit(data: bytes, component: Component | None, otherwise: str, path: Path) -> str:
    """Return a unit as text; that of another kind of object, or none, is the usual one."""
    if component is None or component.kind != "o":
        return otherwise
    _, unit = _object(data, component.begin, component.end, path)
    return _text(data, unit.get("unitstr"), otherwise) or otherwise


def _text(data: bytes, component: Component | None, otherwise: str) -> str:
    """Return a text without the NUL at its end."""
    if component is None or component.kind != "s":
        return otherwise
    return data[component.begin : component.end - 1].decode("utf-8", "replace")


def _object(data: bytes, begin: int, stop: int, path: Path) -> tuple[str, dict[str, Component]]:
    """Return the type of an object and its components by name. Raises: MeasurementError."""
    first, end = _bounds(data, begin, stop, path)
    name = data[begin : first - 5].decode("ascii", "replace")
    return name, dict(_components(data, first, end, path))


def _components(data: bytes, at: int, stop: int, path: Path) -> Iterator[tuple[str, Component]]:
    """Yield names and places of the components in bytes at … stop − 1."""
    while at < stop:
        begin = _after(data, at, stop, path) + 1
        kind = data[begin - 1 : begin].decode("ascii", "replace")
        end = _end(data, kind, begin, stop, path)
        yield data[at : begin - 2].decode("utf-8", "replace"), Component(kind, begin, end)
        at = end


def _end(data: bytes, kind: str, begin: int, stop: int, path: Path) -> int:
    """Return the end of a value. Raises: MeasurementError for one that leaves its object."""
    item = kind.lower()
    if kind in SIZES:
        return _within(begin + SIZES[kind], stop, path)
    if kind == "s":
        return _after(data, begin, stop, path)
    if kind == "o":
        return _bounds(data, begin, stop, path)[1]
    at = _within(begin + 4, stop, path)
    count = int.from_bytes(data[begin:at], "little")
    if kind != "B" and item in SIZES:
        return _within(at + count * SIZES[item], stop, path)
    if kind not in ("S", "O"):
        raise MeasurementError(
            f"{path}: a component of type {kind!r}, which Gwyddion's files do not have; save it "
            "again"
        )
    for _ in range(count):
        at = _end(data, item, at, stop, path)
    return at


def _bounds(data: bytes, begin: int, stop: int, path: Path) -> tuple[int, int]:
    """Return where the components of an object begin and end."""
    size = _after(data, begin, stop, path)
    first = _within(size + 4, stop, path)
    return first, _within(first + int.from_bytes(data[size:first], "little"), stop, path)


def _after(data: bytes, begin: int, stop: int, path: Path) -> int:
    """Return the byte after the NUL that ends a text."""
    return _within(data.find(b"\0", begin, stop) + 1 or stop + 1, stop, path)


def _within(end: int, stop: int, path: Path) -> int:
    """Return an end that does not pass a stop. Raises: MeasurementError."""
    if end > stop:
        raise MeasurementError(f"{path}: cut off or damaged; save it again")
    return end


FORMAT = Format("Gwyddion file", lambda path: head(path, len(START)) == START, _read, priority=2)
