"""What `femnl geometry check` says and draws."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from femnl.cli._output import console, note, table
from femnl.core.device import Model
from femnl.core.errors import GeometryError
from femnl.core.outline import Holes
from femnl.device.geometry import parse
from femnl.device.geometry.naming import place
from femnl.device.geometry.reader import describe, sketch
from femnl.device.layout import import_layout, read_drawing
from femnl.device.layout.regions import faults_of
from femnl.device.mesh import mesh
from femnl.io.results.atomic import write_whole
from femnl.mechanics.compression import ReleasedStress, released_stress
from femnl.plot.layout import faults_figure, layout_figure

DPI = 200
PARTS = {1: "the whole film", 2: "a half", 4: "a quarter"}


def check_geometry(path: Path, text: str, picture: Path) -> None:
    """Check a geometry file by its text.

    Raises:
        GeometryError: the first fault, once the picture is written.
    """
    drawn = sketch(text, str(path))
    if not drawn.faults:
        _show(parse(text, str(path)), picture)
        return
    points = [fault.point for fault in drawn.faults if fault.point is not None]
    figure = faults_figure([drawn.outline], drawn.holes, drawn.openings, points, path.name)
    _save(figure, picture)
    for fault in drawn.faults[1:]:
        note(f"also: {fault}")
    raise GeometryError(f"{path}: {drawn.faults[0]}")


def check_layout(
    path: Path,
    layers: Mapping[str, str],
    picture: Path,
    *,
    like: Model,
    cell: str | None,
    unit: str | None,
    metal: Mapping[str, Any] | None,
) -> None:
    """Check a layout: its faults, and the geometry that it makes.

    Args:
        path: of the layout.
        layers: by role.
        picture: to write.
        like: the device that lends what the layout does not hold.
        cell: of the layout.
        unit: of its coordinates.
        metal: numbers of the layer `metal`, as of `import_layout`.

    Raises:
        GeometryError: the first fault that forbids an import, once the picture is written.
    """
    drawing = read_drawing(path, cell, layers, unit)
    faults = faults_of(drawing)
    for fault in faults:
        note(str(fault))
    if not any(fault.fatal for fault in faults):
        found = import_layout(path, layers, like, cell, unit, metal)
        for line in found.assumed:
            note(line)
        _show(found.model, picture)
        return
    polygons = [p for drawn in drawing.polygons.values() for p in drawn]
    points = [fault.point for fault in faults]
    none = Holes(np.empty((0, 2)), 0.0)
    _save(faults_figure(polygons, none, [], points, path.name), picture)
    first = next(fault for fault in faults if fault.fatal)
    raise GeometryError(f"{path}: {first}; mend the layout")


def _show(model: Model, picture: Path) -> None:
    """Say and draw what a sound geometry is, and its stress after release."""
    domain = mesh(model)
    stress = released_stress(domain)
    edges = model.outline.segments
    held = sum(segment.clamped for segment in edges)
    rows = [
        ["device", describe(model)],
        ["edge", f"{len(edges)} pieces, {held} of them clamped"],
        ["symmetry", f"{PARTS[domain.copies]} is solved"],
        ["mesh", f"{domain.mesh.nelements} triangles"],
        ["compression after release", _compression(stress)],
    ]
    console().print(table(model.name, ["what", "found"], rows))
    _save(layout_figure(model, stress), picture)


def _compression(stress: ReleasedStress) -> str:
    if not stress.compressed.any():
        return "none"
    least, point = stress.worst
    return (
        f"{100 * stress.share:.2g} % of the film, down to {least * 1e-6:.4g} MPa at {place(point)}"
    )


def _save(figure: Figure, picture: Path) -> None:
    write_whole(picture, partial(figure.savefig, dpi=DPI))
    note(f"wrote {picture}")
