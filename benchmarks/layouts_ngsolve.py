"""A drawn film with femnl and with NGSolve, both whole: first frequencies, processor time, memory.

Run `python -m benchmarks.layouts_ngsolve GEOMETRY COUNT SIZE RIM ORDER` beside an NGSolve that is
installed. SIZE and RIM [µm]: the largest elements in the film and along free edges, graded by 0.5.
Outlines and openings may have straight edges and arcs of circles.
"""

import resource
import subprocess
import sys
from importlib import import_module
from typing import Any

import numpy as np
import typer

from benchmarks.peers_ngsolve import UNIT, lowest, plate, relaxed_tension, rigidity
from femnl import load, solve_modes
from femnl.core.device import Model
from femnl.core.outline import Segment
from femnl.device.geometry.curves import point_at
from femnl.device.geometry.shapes import ellipse

GRADING = 0.5


def with_femnl(name: str, count: int) -> None:
    """Print frequencies with their error bars."""
    modes = solve_modes(load(name), count, cache=False)
    for frequency, error in zip(modes.frequency, modes.frequency_error, strict=True):
        typer.echo(f"{frequency:.3f} ± {error:.3f} Hz")


def with_ngsolve(name: str, count: int, size: float, rim: float, order: int) -> None:
    """Print frequencies of NGSolve's plate."""
    ng = import_module("ngsolve")
    model = load(name)
    film = model.film
    shape = import_module("netgen.occ").OCCGeometry(_shape(model, rim), dim=2)
    mesh = ng.Mesh(shape.GenerateMesh(maxh=size, grading=GRADING))
    mesh.Curve(order)
    tension = relaxed_tension(mesh, model, order, "edge", "edge")
    space = ng.H1(mesh, order=order, dirichlet="edge")
    w, z = space.TnT()
    mass = ng.BilinearForm(w * z * ng.dx, symmetric=True).Assemble()
    inverse = plate(space, tension, rigidity(model), film.poisson, "edge")
    squares = np.sort(lowest(inverse, mass.mat, space.FreeDofs(), count))[:count]
    for frequency in np.sqrt(squares * film.stress / film.density) / (2 * np.pi) * UNIT:
        typer.echo(f"{frequency:.3f} Hz")
    typer.echo(f"{mesh.ne} elements of order {order}")


def _shape(model: Model, rim: float) -> Any:
    """Return the film [µm] with its clamped edges named "edge" and free ones no longer than rim."""
    occ = import_module("netgen.occ")
    outline = model.edge_outline
    film = occ.Face(_wire(outline.segments))
    radius = model.holes.radius
    rims = [hole.segments for hole in model.openings]
    rims += [ellipse((x, y), (radius, radius)) for x, y in model.holes.centres]
    cuts = [occ.Face(_wire(rim_of_hole)) for rim_of_hole in rims]
    middles = np.array([point_at(segment, 0.5) for segment in outline.segments]) * UNIT
    for edge in film.edges:
        nearest = np.argmin(np.hypot(*(middles - (edge.center.x, edge.center.y)).T))
        edge.name = "edge" if outline.segments[nearest].clamped else "free"
    for edge in (edge for cut in cuts for edge in cut.edges):
        edge.name = "free"
    if cuts:
        film = film - (occ.Glue(cuts) if len(cuts) > 1 else cuts[0])
    for edge in film.edges:
        if edge.name != "edge":
            edge.maxh = rim
    return film


def _wire(segments: tuple[Segment, ...]) -> Any:
    occ = import_module("netgen.occ")

    def point(place: Any) -> Any:
        return occ.Pnt(float(place[0]) * UNIT, float(place[1]) * UNIT, 0)

    edges = []
    for segment in segments:
        if segment.semi_axes is not None:
            raise SystemExit("an ellipse: NGSolve is given straight edges and arcs of circles")
        start, end = point(segment.start), point(segment.end)
        if segment.centre is None:
            edges.append(occ.Segment(start, end))
        else:
            edges.append(occ.ArcOfCircle(start, point(point_at(segment, 0.5)), end))
    return occ.Wire(edges)


def main() -> None:
    """Run each in a process of its own, and print what it took."""
    name, count, *numbers = sys.argv[1:]
    if name == "--one":
        solver, device, many, *rest = sys.argv[2:]
        if solver == "femnl":
            with_femnl(device, int(many))
        else:
            with_ngsolve(device, int(many), float(rest[0]), float(rest[1]), int(rest[2]))
        used = resource.getrusage(resource.RUSAGE_SELF)
        typer.echo(f"{used.ru_utime + used.ru_stime:.1f} s, {used.ru_maxrss / 1024:.0f} MiB")
        return
    for solver in ("femnl", "ngsolve"):
        typer.echo(solver)
        words = [sys.executable, "-m", "benchmarks.layouts_ngsolve", "--one", solver, name, count]
        subprocess.run([*words, *numbers], check=True)


if __name__ == "__main__":
    main()
