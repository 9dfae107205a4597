"""`femnl show FILE`: what a measurement file holds, in words and as figures."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from femnl.cli._device import MeasurementFile
from femnl.cli._output import console, note, table
from femnl.core.errors import GeometryError

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr
    from numpy.typing import NDArray

Out = Annotated[
    Path, typer.Option(help="Folder for the figures, one a measurement; it is made where missing.")
]


def command(
    file: MeasurementFile,
    out: Out = Path(),
) -> None:
    """Print what a measurement file holds, and draw every measurement in it."""
    from femnl.io import measurement
    from femnl.io.measurement.head import need_version

    need_version(file)  # before arrays and figures load
    measurement.need_room(file, "show")
    from femnl.io.results.atomic import make_folder, write_whole
    from femnl.plot.measurement import figures

    tree = measurement.read(file)
    for repair in tree.attrs["repairs"]:
        note(f"repaired: {repair}")
    rows = [
        [str(key), str(value)]
        for key, value in tree.attrs.items()
        if key not in ("repairs", "model")
    ]
    console().print(table(str(file), ["attribute", "value"], rows))
    for name, node in tree.children.items():
        console().print(table(f"\n{name}", ["dataset", "shape", "range"], _rows(node.to_dataset())))
    make_folder(out)
    for name, figure in figures(tree, _outline(tree, file)).items():
        picture = out / f"{file.stem}-{name}.png"
        write_whole(picture, partial(figure.savefig, dpi=200))
        note(f"wrote {picture}")


def _rows(dataset: xr.Dataset) -> list[list[str]]:
    rows = []
    for name, values in dataset.variables.items():
        shape = " × ".join(f"{size} {dim}" for dim, size in values.sizes.items()) or "one"
        if values.dtype.kind in "fi" and values.size > 1:
            span = f"{float(values.min()):.6g} … {float(values.max()):.6g}"
        else:
            span = ", ".join(map(str, values.values.ravel()[:6])) + (
                " …" if values.size > 6 else ""
            )
        rows.append([str(name), shape, f"{span} {values.attrs.get('units', '')}"])
    return rows + [[key, "attribute", str(value)] for key, value in dataset.attrs.items()]


def _outline(tree: xr.DataTree, file: Path) -> NDArray[np.float64] | None:
    """Return the outline of the file's device, to draw into maps.

    The result is None where the file names no device that femnl knows.
    """
    from femnl.device.geometry.curves import polyline
    from femnl.pipeline import measured_device

    if (
        not any(node.attrs["kind"] == "map" for node in tree.children.values())
        or "geometry" not in tree.attrs
    ):
        return None
    try:
        return polyline(measured_device(tree.attrs, file).outline)
    except GeometryError as error:
        note(f"maps are drawn without an outline: {error}")
        return None
