"""Files that labs have, turned into measurement files.

Every module of this folder that defines FORMAT reads one format; those of other packages are found
by their entry points.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import TYPE_CHECKING

from femnl.core.errors import MeasurementError, ParameterError
from femnl.core.plugins import Defined, by_name, plug_ins
from femnl.core.resources import need_file
from femnl.io import measurement
from femnl.io.labfiles.base import Format
from femnl.io.labfiles.spec import Spec, read_spec
from femnl.io.labfiles.stated_values import with_values

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["Format", "Spec", "formats", "import_file", "is_lab_file", "read_lab_files", "read_spec"]

GROUP = "femnl.labfiles"
"""Entry points of this group name modules that define FORMAT."""


@cache
def formats() -> tuple[Format, ...]:
    """Return all formats, by name: FORMAT of the modules here that have one, and of each plug-in.

    Raises: ParameterError for a plug-in that defines no format, or one of a name that is taken.
    """
    modules = [import_module(f"{__name__}.{found.name}") for found in iter_modules(__path__)]
    own = [
        Defined(module.FORMAT, module.__name__) for module in modules if hasattr(module, "FORMAT")
    ]
    found = by_name([*own, *plug_ins(GROUP, "FORMAT", Format)])
    return tuple(found[name] for name in sorted(found))


def import_file(
    source: str | Path | Sequence[str | Path],
    dest: str | Path,
    spec: str | Path | Spec | None = None,
) -> xr.DataTree:
    """Turn files of a lab into a measurement file.

    Args: source: a file, a folder of files of one format, or several files; dest: the .nc file to
    write; spec: TOML file that says which column is what (default: the source's name with .toml,
    where there is one).
    Returns: the tree as written; its attribute `repairs` tells what was assumed and changed.
    Raises: MeasurementError with file, what is wrong and the remedy; ParameterError for a plug-in
    that defines no format, and for a dest that does not end in .nc or is one of the sources.
    """
    _refuse_dest(source, Path(dest))
    tree = read_lab_files(source, spec)
    measurement.write(tree, dest)
    return tree


def _refuse_dest(source: str | Path | Sequence[str | Path], dest: Path) -> None:
    """Refuse to write over what was measured, as where the name of the new file was forgotten."""
    if dest.suffix != ".nc":
        raise ParameterError(
            f"{dest}: expected a name that ends in .nc; name the measurement file to write last"
        )
    sources = [source] if isinstance(source, str | Path) else source
    if any(Path(one).resolve() == dest.resolve() for one in sources):
        raise ParameterError(f"{dest}: is a source; give the measurement file another name")


def is_lab_file(path: Path) -> bool:
    """Whether a file is of a format that is known. Raises: as `formats`."""
    return any(kind.recognise(path) for kind in formats())


def read_lab_files(
    source: str | Path | Sequence[str | Path], spec: str | Path | Spec | None = None
) -> xr.DataTree:
    """Read files of a lab as measurements, as `import_file` does, and write nothing."""
    files = _files(source)
    recognised = [_recognise(path) for path in files]
    found = {one.name: one for one in recognised}
    if len(found) > 1:
        raise MeasurementError(
            f"{files[0].parent}: holds files of several formats ({', '.join(found)}); import one "
            "format at a time"
        )
    (reader,) = found.values()
    if not isinstance(spec, Spec):
        beside = files[0].with_suffix(".toml")
        spec = (
            read_spec(Path(spec))
            if spec is not None
            else read_spec(beside)
            if beside.is_file()
            else Spec()
        )
    groups, notes = reader.read(files, spec)
    groups = with_values(groups, spec, str(files[0]))
    attributes = {
        key: value
        for key, value in (("title", spec.title), ("sample", spec.sample))
        if value is not None
    }
    tree = measurement.bundle(
        groups,
        geometry=spec.geometry,
        **attributes,
        source=f"{reader.name}: {', '.join(path.name for path in files)}",
    )
    tree.attrs["repairs"] = (*notes, *tree.attrs["repairs"])
    return tree


def _files(source: str | Path | Sequence[str | Path]) -> list[Path]:
    paths = [Path(source)] if isinstance(source, str | Path) else [Path(path) for path in source]
    if len(paths) == 1 and paths[0].is_dir():
        folder = paths[0]
        paths = sorted(path for path in folder.iterdir() if path.is_file() and is_lab_file(path))
        if not paths:
            raise MeasurementError(
                f"{folder}: no file of a known format; known are "
                f"{', '.join(kind.name for kind in formats())}"
            )
    for path in paths:
        need_file(path)
    if not paths:
        raise MeasurementError("import: no file given; name at least one")
    return paths


def _recognise(path: Path) -> Format:
    hits = [kind for kind in formats() if kind.recognise(path)]
    if not hits:
        raise MeasurementError(
            f"{path}: format not recognised; known are {', '.join(kind.name for kind in formats())}"
        )
    return max(hits, key=lambda kind: kind.priority)
