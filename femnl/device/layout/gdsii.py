"""GDSII and OASIS through gdstk."""

import warnings
from collections.abc import Mapping
from pathlib import Path

import gdstk
import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import GeometryError, one_line, suggest
from femnl.device.layout.drawing import Drawing, Fault

Array = NDArray[np.float64]

MOST = 200_000
"""Polygons of a cell; a film has at most 100 000 holes."""


def read(path: Path, cell: str | None, layers: Mapping[str, str], unit: str | None) -> Drawing:
    """Read the polygons and paths of one cell, references included; see `readers.read`."""
    if unit is not None:
        raise GeometryError(one_line(f"{path}: this file names its unit; leave --unit out"))
    chosen, size, grid = _open(path, cell)
    _refuse_many(path, chosen)
    polygons: dict[str, list[Array]] = {}
    faults = []
    for role, layer in layers.items():
        number, kind = _numbers(path, role, layer)
        found = chosen.get_polygons(layer=number, datatype=kind)
        open_paths = _open_paths(chosen, number, kind)
        if not found and not open_paths:
            known = sorted({f"{p.layer}/{p.datatype}" for p in chosen.get_polygons()})
            raise GeometryError(
                one_line(
                    f"{path}: layer {layer} ({role}) of cell {chosen.name} is empty; expected one "
                    f"of {', '.join(known)}"
                )
            )
        # A path without a width comes as a polygon of its two ends
        areas = [np.asarray(polygon.points) for polygon in found if len(polygon.points) > 2]
        polygons[role] = [_on_grid(points, size, grid) for points in areas]
        for x, y in open_paths:
            where = (float(x) * size, float(y) * size)
            faults.append(Fault(f"open path on layer {layer} ({role})", where, True))
    return Drawing(chosen.name, grid, polygons, faults=tuple(faults))


def _open_paths(cell: gdstk.Cell, layer: int, kind: int) -> list[Array]:
    """Starts (2,) of paths without a width, which enclose nothing."""
    paths = cell.get_paths(layer=layer, datatype=kind)
    flexible = [p for p in paths if isinstance(p, gdstk.FlexPath)]
    return [p.spine()[0] for p in flexible if not np.any(p.widths())]


def _open(path: Path, cell: str | None) -> tuple[gdstk.Cell, float, float]:
    """The cell that was asked for, the unit of its coordinates [m] and their step [m]."""
    gds = path.suffix.lower() == ".gds"
    open_file = gdstk.read_gds if gds else gdstk.read_oas
    try:
        with warnings.catch_warnings():
            if not gds:
                # Records of OASIS do not tell their length: behind one that gdstk does not know
                # it reads anything
                warnings.simplefilter("error", RuntimeWarning)
            library = open_file(str(path))
        cells = {c.name: c for c in library.cells if isinstance(c, gdstk.Cell)}
    # TypeError: a name that is no text
    except (OSError, RuntimeError, RuntimeWarning, TypeError, ValueError) as error:
        raise GeometryError(
            one_line(f"{path}: not a whole {path.suffix[1:].upper()} file; export it again")
        ) from error
    if cell is not None and cell not in cells:
        raise GeometryError(one_line(f"{path}: no cell {cell}; {suggest(cell, list(cells))}"))
    top = [c.name for c in library.top_level() if isinstance(c, gdstk.Cell)]
    if cell is None and len(top) != 1:
        names = ", ".join(sorted(top)) or "none"
        raise GeometryError(one_line(f"{path}: top cells: {names}; choose one with --cell"))
    return cells[cell or top[0]], library.unit, library.precision


def _refuse_many(path: Path, cell: gdstk.Cell) -> None:
    """Refuse a cell of more polygons than a device has, before references are followed.

    A few arrays of arrays draw more than any memory holds, where gdstk ends the whole process.
    """
    count = _drawn(path, cell, {}, ())
    if count > MOST:
        raise GeometryError(
            one_line(
                f"{path}: cell {cell.name} draws {count:,} polygons with all references, and a "
                f"device has at most {MOST:,}; choose a cell of one device with --cell"
            )
        )


def _drawn(path: Path, cell: gdstk.Cell, known: dict[str, int], above: tuple[str, ...]) -> int:
    """Return how many polygons and paths a cell draws. known: of cells, by name, filled here."""
    if cell.name in above:
        raise GeometryError(one_line(f"{path}: cell {cell.name} refers to itself; export it again"))
    if cell.name not in known:
        count = len(cell.polygons) + len(cell.paths)
        for reference in cell.references:
            if isinstance(reference.cell, gdstk.Cell):
                inside = _drawn(path, reference.cell, known, (*above, cell.name))
                count += max(reference.repetition.size, 1) * inside
        known[cell.name] = count
    return known[cell.name]


def _numbers(path: Path, role: str, layer: str) -> tuple[int, int]:
    """Layer and datatype of a text such as "1/0", or "1"."""
    number, _, kind = layer.partition("/")
    if not number.isdecimal() or not (kind or "0").isdecimal():
        raise GeometryError(
            one_line(f"{path}: layer {layer} ({role}): expected numbers, write e.g. {role}=1/0")
        )
    return int(number), int(kind or 0)


def _on_grid(points: Array, unit: float, grid: float) -> Array:
    """Corners (n, 2) [m], each the double nearest to a whole number of steps where it is one."""
    steps = points * (unit / grid)
    whole = np.rint(steps)
    per_metre = round(1 / grid)
    exact = whole / per_metre if abs(per_metre * grid - 1) < 1e-12 else whole * grid
    return np.where(np.abs(steps - whole) < 1e-3, exact, steps * grid)
