"""Round holes that all differ, from a layout to a mesh, by femnl and by the mesher of NGSolve.

Run `python -m benchmarks.circles [FOLDER]`; it writes circles.csv. Each step is a process of its
own, from its start to its end. femnl imports a layout of chords, and meshes what it wrote. NGSolve
reads no layouts: it is given the circles, with about as many triangles. Its rows are left out where
it is not installed.
"""

import csv
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import gdstk
import numpy as np
import typer
from numpy.typing import NDArray

SEED = 1
SIDES = (20, 40, 100)
"""Holes along a side of the film."""
PITCH = 10.0
LEAST, MOST, AWAY = 1.0, 3.0, 1.0
"""Radii, and how far a hole lies off its place in a square lattice at most [µm]."""
CHORD = 3e-3
"""How far the chords of the layout leave a circle at most [µm]."""
OF_A_RIM = 12
"""Elements around a hole: as many as femnl makes."""
NETGEN = "--netgen"
HEAD = ("holes", "step", "triangles", "time [s]", "processor [s]", "peak [MiB]")


def circles(side: int) -> NDArray[np.float64]:
    """Return x, y and radius (side², 3) [µm] of the holes."""
    rng = np.random.default_rng(SEED)
    n = side**2
    places = PITCH * (np.arange(side) + 0.5)
    centres = np.stack(np.meshgrid(places, places), axis=-1).reshape(n, 2)
    centres += rng.uniform(-AWAY, AWAY, (n, 2))
    return np.column_stack([centres, rng.uniform(LEAST, MOST, n)])


def draw(path: Path, side: int) -> None:
    """Write the layout: the film in layer 1/0, the holes in layer 2/0."""
    library = gdstk.Library()
    cell = library.new_cell("FILM")
    cell.add(gdstk.rectangle((0, 0), (side * PITCH, side * PITCH), layer=1))
    for x, y, radius in circles(side):
        cell.add(gdstk.ellipse((x, y), radius, tolerance=CHORD, layer=2))
    library.write_gds(path)


def with_netgen(side: int) -> int:
    """Mesh the circles by the mesher of NGSolve, and return the triangles."""
    drawing = import_module("netgen.geom2d").SplineGeometry()
    width = side * PITCH
    drawing.AddRectangle((0, 0), (width, width))
    for x, y, radius in circles(side):
        longest = 2 * np.pi * radius / OF_A_RIM
        drawing.AddCircle((x, y), radius, leftdomain=0, rightdomain=1, maxh=longest)
    return len(drawing.GenerateMesh(maxh=width / 20, grading=0.5).Elements2D())


def timed(words: Sequence[str]) -> tuple[str, float, float, float]:
    """Run a command; return what it prints, seconds by the clock and of a processor, and MiB."""
    started = time.perf_counter()
    with tempfile.TemporaryFile("w+") as printed:
        child = subprocess.Popen(words, stdout=printed)
        _, status, used = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        if child.returncode:
            raise SystemExit(f"{' '.join(words)}: exit {child.returncode}")
        printed.seek(0)
        text = printed.read()
    processor = used.ru_utime + used.ru_stime
    return text, time.perf_counter() - started, processor, used.ru_maxrss / 1024


def rows_of(side: int, folder: Path) -> list[Sequence[object]]:
    """Return a row for each step."""
    layout, geometry = folder / "film.gds", folder / "film.toml"
    draw(layout, side)
    femnl = [sys.executable, "-m", "femnl"]
    layers = "film=1/0,holes=2/0"
    _, *import_costs = timed(
        [*femnl, "geometry", "import", str(layout), str(geometry), "--layers", layers]
    )
    text, *mesh_costs = timed([*femnl, "mesh", str(geometry), "--json"])
    rows: list[Sequence[object]] = [
        (side**2, "femnl geometry import", "", *import_costs),
        (side**2, "femnl mesh", json.loads(text)["triangles"], *mesh_costs),
    ]
    if find_spec("netgen"):
        text, *costs = timed([sys.executable, "-m", "benchmarks.circles", NETGEN, str(side)])
        rows.append((side**2, "NGSolve, mesh", int(text), *costs))
    return rows


def main(folder: str = ".") -> None:
    """Write the table."""
    path = Path(folder) / "circles.csv"
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(HEAD)
        for side in SIDES:
            with tempfile.TemporaryDirectory() as drawn:
                for row in rows_of(side, Path(drawn)):
                    table.writerow(row)
                    typer.echo(" ".join(map(str, row)))


if __name__ == "__main__":
    if NETGEN in sys.argv:
        typer.echo(with_netgen(int(sys.argv[-1])))
    else:
        main(*sys.argv[1:])
