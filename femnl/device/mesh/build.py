"""Meshes of the film by gmsh.

Curved triangles, graded towards clamped edges, corners and holes, whole or by symmetry.
"""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from ctypes import c_int, c_void_p, pythonapi
from dataclasses import replace
from signal import SIGPIPE

import gmsh
import numpy as np
from numpy.typing import NDArray

from femnl.core.choices import check_resolution
from femnl.core.device import Model
from femnl.core.domain import Domain
from femnl.core.errors import GeometryError
from femnl.core.memory import need_memory
from femnl.core.outline import CELL
from femnl.device.geometry import curves as exact
from femnl.device.geometry.hole_faults import refuse_outside, refuse_overlap
from femnl.device.geometry.openings import drawn, polygon, refuse_misplaced
from femnl.device.geometry.placing import moved
from femnl.device.mesh.classify import classify
from femnl.device.mesh.collect import (
    TRIANGLE,
    Raw,
    assemble,
    check_unfolded,
    collect,
    double,
    misfit,
)
from femnl.device.mesh.grading import SCALE, Fineness, grade
from femnl.device.mesh.layers import covered
from femnl.device.mesh.surface import draw_film
from femnl.device.mesh.symmetry import (
    EIGHTH,
    QUARTER,
    film_middle,
    find_wedge,
    has_symmetry,
)

Array = NDArray[np.float64]
PROGRESS = logging.getLogger("femnl.progress")

# Of memory a triangle by the degree of the elements, for the factorised in-plane stiffness: 38, 81,
# 158, 284 kB at 6820 triangles (peak resident memory, degrees 3 to 6). Factors fill with the number
# of triangles: 111 kB at 70 400 of degree 4.
BYTES = {3: 42_000, 4: 90_000, 5: 180_000, 6: 320_000}
MEASURED = 6820
FILL = 0.1
# Of a triangle of the mesh alone: 2.4 kB at 728 590 triangles around 10 000 openings (peak resident
# memory)
ALONE = 3_000
# Relative error of the number of elements along an edge, by which gmsh places their ends: its 1e-9
# took nine tenths of the time of meshes with many corners or small holes
PLACING = 1e-4
# Lengths of the film between it and the origin: numbers of 16 digits then still place its edges to
# 1e-10 of its length, and gmsh needs 1e-9.
FARTHEST = 1e6


def mesh(
    model: Model,
    symmetry: str = "auto",
    resolution: float = 1.0,
    degree: int = 4,
    wave: float = np.inf,
    alone: bool = False,
) -> Domain:
    """Mesh the film of a device, or the wedge that its mirror symmetry leaves.

    Args: symmetry: `auto` (a quarter or half where outline and holes allow, else the whole film),
        `full`, `half`, `quarter`, `eighth` or `twelfth`. resolution: factor on the number of
        elements per length; 2 halves every element. degree: of the elements that are meant for it,
        by which their memory is foreseen. wave: length [m] of the shortest waves that the elements
        have to follow, see `waves`. alone: nothing is to be solved on it, so that its own memory is
        foreseen and not that of modes.
    Returns: curved triangles with boundaries `clamped`, `free`, `mirror-0`, `mirror-1`, as present.
    Raises: ParameterError where the device lacks the symmetry asked for; GeometryError where
    meshing fails.
    """
    check_resolution(resolution)
    if not any(s.clamped for s in model.outline.segments):
        raise GeometryError(
            f"{model.name}: no edge of the outline is clamped, so that nothing holds the film; "
            "clamp at least one"
        )
    _refuse_crossings(model)
    PROGRESS.info("%s: meshing", model.name)
    wedge = find_wedge(model, symmetry)
    diagonal = wedge == QUARTER and has_symmetry(model, EIGHTH)
    middle = _middle(model)
    # gmsh's tolerances are absolute, so that a film far from the origin would mesh differently
    centred = moved(model, -middle) if middle.any() else model
    fineness = Fineness(resolution, degree, wave)
    with _gmsh_session():
        raw = (
            double(_build(centred, EIGHTH, fineness, 2, alone))
            if diagonal
            else _build(centred, wedge, fineness, 1, alone)
        )
    result = assemble(replace(raw, points=raw.points + middle))
    check_unfolded(model, result)
    if model.overhang is not None:
        outside = ~exact.contains(model.outline, result.p[:, result.t].mean(axis=1).T)
        result = replace(result, _subdomains={"overhang": np.flatnonzero(outside)})
    if model.layers:
        result = replace(result, _subdomains=covered(model, result))
    x, y = map(float, middle)
    return Domain(model, result, wedge, diagonal, misfit=misfit(model, result), middle=(x, y))


def _middle(model: Model) -> Array:
    """Return the middle (2,) [m] of the film.

    Raises: GeometryError where the film is too far from the origin for its coordinates.
    """
    middle = film_middle(model)
    away = float(np.hypot(*middle))
    if away > FARTHEST * model.outline.length:
        raise GeometryError(
            f"{model.name}: the film lies {away:.4g} m from the origin, more than {FARTHEST:g} "
            f"times its length of {model.outline.length:.4g} m, where 16 digits no longer tell its "
            "edges; move it and its holes nearer to the origin"
        )
    return middle


@contextmanager
def _broken_pipes_as_before() -> Iterator[None]:
    """Undo what gmsh's first start does: it lets the signal SIGPIPE end the process.

    Python ignores that signal, so that writing to a reader that has gone raises BrokenPipeError.
    `signal.signal` would serve the main thread alone, and knows nothing of what gmsh has set.
    """
    of_signal, set_signal = pythonapi.PyOS_getsig, pythonapi.PyOS_setsig
    of_signal.restype, of_signal.argtypes = c_void_p, [c_int]
    set_signal.restype, set_signal.argtypes = c_void_p, [c_int, c_void_p]
    before = of_signal(SIGPIPE)
    try:
        yield
    finally:
        set_signal(SIGPIPE, before)


@contextmanager
def _gmsh_session() -> Iterator[None]:
    """One gmsh model, closed whatever happens.

    One thread and no rounding by clock make meshes reproducible.
    """
    with _broken_pipes_as_before():
        gmsh.initialize(interruptible=False)
    try:
        for option, value in {
            "General.Terminal": 0,
            "General.NumThreads": 1,
            "Mesh.MeshSizeExtendFromBoundary": 0,
            "Mesh.LcIntegrationPrecision": PLACING,
        }.items():
            gmsh.option.setNumber(option, value)
        gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
        gmsh.option.setNumber("Mesh.Algorithm", 6)
        gmsh.model.add("film")
        yield
    finally:
        gmsh.finalize()


def _need_memory(model: Model, triangles: float, degree: int, alone: bool) -> None:
    """Refuse a mesh that does not fit into memory, or on which modes of a degree would not."""
    remedy = "lower the resolution"
    if alone:
        need_memory(ALONE * triangles, f"{model.name}: {triangles:.2g} triangles", remedy)
        return
    what = f"{model.name}: modes of degree {degree} on {triangles:.2g} triangles"
    fill = max(triangles / MEASURED, 1.0) ** FILL
    need_memory(BYTES[max(degree, min(BYTES))] * fill * triangles, what, remedy)


def _build(model: Model, wedge: float, fineness: Fineness, copies: int, alone: bool) -> Raw:
    unit = SCALE / model.outline.length
    try:
        rims = draw_film(model, wedge, unit)
        curves = classify(model, rims, wedge, unit)
        triangles = copies * grade(model, curves, wedge, unit, fineness)
        PROGRESS.info("%s: about %.3g triangles", model.name, triangles)
        _need_memory(model, triangles, fineness.degree, alone)
        gmsh.model.mesh.generate(2)
    except Exception as error:
        if type(error) is not Exception:  # gmsh knows no other class for its failures
            raise
        raise GeometryError(
            f"{model.name}: the mesher failed ({error}); check for holes or edges closer to each "
            "other than 1e-8 of the outline"
        ) from error
    if len(gmsh.model.mesh.getElementsByType(TRIANGLE)[0]) == 0:
        raise _no_film(model)
    mirrors = {f"mirror-{k}": tags for k, tags in enumerate(curves.mirrors)}
    free = curves.free + curves.holes + curves.openings
    return collect({"clamped": curves.clamped, "free": free, **mirrors}, unit)


def _refuse_crossings(model: Model) -> None:
    """Refuse an outline that crosses itself, and holes and openings that meet it or each other.

    gmsh never ends on them. Files are refused before; a model may be changed since.
    """
    if not polygon(model.edge_outline).is_valid:
        raise _no_film(model)
    refuse_overlap(model.holes)
    if model.outline.kind != CELL:
        refuse_outside(model.holes, model.edge_outline)
        refuse_misplaced(drawn(model.openings), model.holes, model.edge_outline)


def _no_film(model: Model) -> GeometryError:
    """Return the refusal of an outline around nothing."""
    return GeometryError(
        f"{model.name}: the outline encloses no film; give its edges in order, counter-clockwise "
        "and without crossings"
    )
