"""Where the shipped geometries and validation cases lie.

Inside an installed wheel, or at the top of a checkout.
"""

import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from femnl.core.errors import GeometryError, MeasurementError, ParameterError, one_line

HEAD = 4096
"""Bytes of a file by which text is told from numbers."""
TEXT = bytes({*range(7, 14), 27, *range(32, 127), *range(128, 256)})
"""Bytes that texts are made of, in any encoding that has one byte for a letter of ASCII."""
SIGNATURE = b"\x89HDF\r\n\x1a\n"
USER_BLOCK = 512
"""Bytes that may stand before an HDF5 file, or a power of two times as many."""
_PACKAGE = Path(__file__).parents[1]


def geometries() -> Path:
    """Return the folder of the shipped geometry files, one TOML a device."""
    return _folder("geometries")


def find_geometry(name_or_path: str | Path) -> Path:
    """Return the file of a geometry: that of a shipped name, else the path itself.

    Raises: GeometryError where it is neither.
    """
    path = Path(name_or_path)
    if str(name_or_path) not in _names() and (path.suffix == ".toml" or path.is_file()):
        return path
    return find_shipped(str(name_or_path), "neither a shipped geometry nor a file")


def find_shipped(name: str, otherwise: str = "no shipped geometry") -> Path:
    """Return the file of a shipped geometry, and never one elsewhere.

    Raises: GeometryError where there is none; `otherwise` says what the name is instead.
    """
    names = _names()
    if name in names:
        return geometries() / f"{name}.toml"
    close = get_close_matches(name, names, n=1)
    hint = f"did you mean {close[0]}?" if close else f"shipped are {', '.join(names)}"
    raise GeometryError(one_line(f"{name}: {otherwise}; {hint}"))


def need_file(path: Path) -> Path:
    """Return the path of a file that must be there.

    Raises: MeasurementError where nothing is, and for a folder.
    """
    if path.is_dir():
        raise MeasurementError(f"{path}: is a folder; name a file in it")
    if not path.is_file():
        raise MeasurementError(f"{path}: no such file; check the path")
    return path


def need_no_text(path: Path) -> Path:
    """Return the path of a file that must be there and be no text, as measurement files are none.

    Raises: MeasurementError, before HDF5 is loaded.
    """
    if need_file(path).stat().st_size == 0:
        raise MeasurementError(f"{path}: is empty; copy or export it again")
    if not is_text(path):
        return path
    if path.suffix == ".toml":
        raise MeasurementError(
            f"{path}: is a TOML file, such as a geometry or a study; name a measurement file (.nc)"
        )
    raise MeasurementError(
        f"{path}: is a text file, and no measurement file (.nc); femnl import makes one of a lab's "
        "file"
    )


def is_text(path: Path) -> bool:
    """Whether a file begins as text does, and is no HDF5 file behind a text of its own."""
    with path.open("rb") as file:
        head = file.read(HEAD)
        at = USER_BLOCK
        while at < path.stat().st_size:
            file.seek(at)
            if file.read(len(SIGNATURE)) == SIGNATURE:
                return False
            at *= 2
    return bool(head) and not head.translate(None, TEXT)


def need_folder(path: Path) -> Path:
    """Return the path of a folder that must be there.

    Raises: ParameterError where none is.
    """
    if not path.is_dir():
        raise ParameterError(f"{path}: no such folder; check the path")
    return path


def _names() -> list[str]:
    return sorted(path.stem for path in geometries().glob("*.toml"))


def shipped() -> list[tuple[str, str]]:
    """List the shipped geometries: name and a one-line description of each, by name.

    The description quotes the files, so that a list needs no units, meshes or arrays.
    """
    files = sorted(geometries().glob("*.toml"))
    return [(file.stem, _described(tomllib.loads(file.read_text("utf-8")))) for file in files]


def _described(tables: Mapping[str, Any]) -> str:
    """Quote the outline, the holes and the film of a geometry file in one line."""
    outline = dict(tables["outline"])
    film = tables["film"]
    groups = tables.get("holes", [])
    groups = groups if isinstance(groups, list) else [groups]
    holes = " and ".join(f"holes {_quoted(group)}" for group in groups) or "no holes"
    parts = [
        f"{outline.pop('kind')}, {_quoted(outline)}".rstrip(", "),
        holes,
        f"film {film['thickness']} at {film['stress']}",
        *(f"{name} {_quoted(tables[name])}" for name in ("clamp", "overhang") if name in tables),
    ]
    return "; ".join(parts)


def _quoted(table: Mapping[str, Any]) -> str:
    """Quote the plain values of a table; lists of points would fill pages."""
    plain = {name: value for name, value in table.items() if not isinstance(value, list)}
    if isinstance(table.get("count"), list):
        plain["count"] = " × ".join(map(str, table["count"]))
    return ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in plain.items())


def cases() -> Path:
    """Return the folder of the shipped validation cases, one Python file a case."""
    return _folder("validation")


def published() -> Path:
    """Return the folder of the published measurements, one TOML a case."""
    return cases() / "published"


def _folder(name: str) -> Path:
    # A wheel carries the folder inside the package (pyproject.toml, force-include); a checkout has
    # it beside the package.
    inside = _PACKAGE / f"_{name}"
    return inside if inside.is_dir() else _PACKAGE.parent / name
