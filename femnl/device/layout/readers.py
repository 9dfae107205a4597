"""Which library reads which layout, imported only where one is read."""

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path

from femnl.core.errors import GeometryError, MissingLibraryError, one_line
from femnl.core.resources import need_file
from femnl.device.layout.apart import apart
from femnl.device.layout.drawing import Drawing

Reader = Callable[[Path, str | None, Mapping[str, str], str | None], Drawing]
"""Path, cell, layer by role, and the unit of a file that names none."""

SUFFIXES = {".gds": "gdsii", ".oas": "gdsii", ".dxf": "dxf", ".svg": "svg"}
APART = frozenset({"gdsii"})
"""Modules whose library, gdstk, dies of one in twelve damaged OASIS files and of some of GDSII."""


def read_drawing(
    path: Path, cell: str | None, layers: Mapping[str, str], unit: str | None
) -> Drawing:
    """Read a layout.

    Args:
        path: of a GDSII, OASIS, DXF or SVG file.
        cell: the cell (GDSII, OASIS) or block (DXF); where there is one top cell, that one.
        layers: the layer of each role: "1/0" of GDSII and OASIS, the name of a layer or group else.
        unit: of coordinates in a file that names none, such as "um".

    Raises:
        GeometryError: a file that is no such layout, or has no such cell or layer.
        MissingLibraryError: the library that reads it is not installed.
    """
    need_file(path)
    name = SUFFIXES.get(path.suffix.lower())
    if name is None:
        raise GeometryError(
            one_line(f"{path}: expected a layout that ends in {', '.join(SUFFIXES)}")
        )
    about = (name, cell, dict(layers), unit)
    return apart(path, _read, *about) if name in APART else _read(path, *about)


def _read(
    path: Path, module: str, cell: str | None, layers: Mapping[str, str], unit: str | None
) -> Drawing:
    try:
        reader: Reader = import_module(f"femnl.device.layout.{module}").read
    except ModuleNotFoundError as error:
        raise MissingLibraryError(
            f"{path}: reading {path.suffix} needs {error.name}; install femnl[layout]"
        ) from error
    return reader(path, cell, layers, unit)
