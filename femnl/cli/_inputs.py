"""Files that a command reads: measurement files, lab files, and folders of both."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from femnl.core.errors import MeasurementError
from femnl.core.resources import need_file

if TYPE_CHECKING:
    import xarray as xr

    from femnl.io.measurement.sizes import Use


def there(paths: list[Path]) -> list[Path]:
    """Refuse what is neither a file nor a folder before anything heavy is loaded."""
    return [path if path.is_dir() else need_file(path) for path in paths]


Inputs = Annotated[
    list[Path],
    typer.Argument(
        metavar="FILE...",
        help="Measurement files (.nc), lab files, or folders of them.",
        show_default=False,
        callback=there,
    ),
]


def files_of(paths: Sequence[Path]) -> list[Path]:
    """Return the files, those of a folder sorted by name. Raises: MeasurementError for none."""
    from femnl.io.labfiles import is_lab_file
    from femnl.io.measurement import is_measurement

    found = []
    for path in paths:
        if path.is_dir():
            inside = sorted(file for file in path.iterdir() if file.is_file())
            usable = [file for file in inside if is_measurement(file) or is_lab_file(file)]
            if not usable:
                raise MeasurementError(f"{path}: holds no measurement file and no lab file")
            found += usable
        else:
            found.append(path)
    return found


def read_file(file: Path, use: Use) -> xr.DataTree:
    """Read one file; a lab file is turned into measurements without being written.

    Args: use: what is done with it, which must not be too much for its size.
    """
    from femnl.io import measurement
    from femnl.io.labfiles import is_lab_file, read_lab_files

    measured = measurement.is_measurement(file) or not is_lab_file(file)
    if measured:
        measurement.need_room(file, use)
        return measurement.read(file)
    tree = read_lab_files(file)
    measurement.need_room_for(tree, str(file), use)
    return tree
