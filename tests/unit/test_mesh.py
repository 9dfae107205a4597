"""Meshes: true to the outline, named all around, graded, reproducible, or refused."""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import combinations

import gmsh
import numpy as np
import pytest
from numpy.typing import NDArray
from skfem import MeshTri1, MeshTri2

from femnl import load
from femnl.core import resources
from femnl.core.device import Film, Model
from femnl.core.domain import Domain
from femnl.core.errors import GeometryError, ParameterError
from femnl.core.outline import Holes, Outline, Segment
from femnl.device.geometry import curves, parse
from femnl.device.geometry.placing import placed
from femnl.device.geometry.shapes import ellipse
from femnl.device.mesh import has_symmetry, mesh
from femnl.device.mesh.collect import check_unfolded
from femnl.device.mesh.grading import bending_length
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import cells

Array = NDArray[np.float64]
Device = Callable[..., Model]

SQUARE = 'kind = "square"\nside = "10 um"'
HEXAGON = 'kind = "regular-polygon"\nsides = 6\nlong_axis = "12 um"'
CIRCLE = 'kind = "circle"\ndiameter = "10 um"'
# A hole at the origin and on every mirror line, so that each wedge cuts some in halves or smaller
# pieces.
ODD_LATTICE = 'lattice = "square"\npitch = "2 um"\ncount = [3, 3]\nradius = "0.5 um"'
THIN = (
    'thickness = "1 nm"\nyoung = "250 GPa"\npoisson = 0.23\ndensity = "3000 kg/m^3"\nstress '
    '= "1 GPa"'
)
HEXAGONAL = 'lattice = "hexagonal"\npitch = "2 um"\nrows = 3\nradius = "0.5 um"'


@pytest.fixture(scope="session")
def device(device: Device) -> Device:
    """Build films of some micrometres, which are thin."""
    return partial(device, film=THIN)


def holes_at(*points: tuple[float, float], radius: float = 0.5e-6) -> Holes:
    return Holes(np.array(points) * 1e-6, radius)


def ring(n: int, start: float) -> list[tuple[float, float]]:
    return [(3 * np.cos(a), 3 * np.sin(a)) for a in start + 2 * np.pi * np.arange(n) / n]


@pytest.fixture(scope="module")
def devices(device: Device) -> dict[str, Model]:
    hexagon = device(HEXAGON)
    trampoline = load("trampoline")
    return {
        "square": device(SQUARE),
        "perforated square": device(SQUARE, ODD_LATTICE),
        "perforated hexagon": replace(
            hexagon, holes=holes_at((0, 0), *ring(6, 0.0), *ring(6, np.pi / 6))
        ),
        "perforated circle": replace(
            device(CIRCLE), holes=holes_at((0, 0), (3, 0), (-3, 0), (0, 3), (0, -3))
        ),
        "trampoline": trampoline,
        "metallised drum": load("metallised-drum"),
    }


def boundary_length(domain: Domain, name: str) -> float:
    """The length of a named boundary, along its quadratic edges."""
    grid = domain.mesh
    total = 0.0
    space = Space(grid, 2)
    for facet in space.boundary_facets(name):
        triangle = np.array([grid.f2t[0, facet]])
        edge = int(np.flatnonzero(grid.t2f[:, triangle[0]] == facet)[0])
        points, weights = space.edge_points(edge, 10)
        along = np.array([[1.0, 0.0], [-1.0, 1.0], [0.0, 1.0]])[edge]
        total += float(
            weights @ np.linalg.norm(space.jet(triangle, points).jacobian[0] @ along, axis=1)
        )
    return total


def area(domain: Domain) -> float:
    return domain.copies * float(sum(cell.dx.sum() for cell in cells(Space(domain.mesh, 1), 4)))


CASES = [
    *(("square", s) for s in ("full", "half", "quarter", "eighth")),
    *(("perforated square", s) for s in ("full", "half", "quarter", "eighth")),
    *(("perforated hexagon", s) for s in ("full", "half", "quarter", "twelfth")),
    *(("perforated circle", s) for s in ("full", "half", "quarter", "eighth")),
    ("trampoline", "full"),
    ("trampoline", "quarter"),
    ("metallised drum", "full"),
]


@pytest.mark.parametrize(("name", "symmetry"), CASES)
def test_every_outer_edge_of_a_mesh_has_exactly_one_name(
    devices: dict[str, Model], name: str, symmetry: str
) -> None:
    grid = mesh(devices[name], symmetry, 0.5).mesh
    named = {key: set(map(int, facets)) for key, facets in (grid.boundaries or {}).items()}
    assert set.union(*named.values()) == set(map(int, grid.boundary_facets()))
    assert all(not named[a] & named[b] for a, b in combinations(named, 2))
    mirrors = {"full": 0, "half": 1}.get(symmetry, 2)
    assert {key for key in named if key.startswith("mirror")} == {
        f"mirror-{k}" for k in range(mirrors)
    }


@pytest.mark.parametrize("symmetry", ["full", "half", "quarter", "eighth"])
def test_area_and_edges_of_a_perforated_square_match_the_closed_form(
    devices: dict[str, Model], symmetry: str
) -> None:
    domain = mesh(devices["perforated square"], symmetry, 2)
    assert area(domain) == pytest.approx(1e-10 - 9 * np.pi * 0.25e-12, rel=1e-8)
    assert domain.copies * boundary_length(domain, "clamped") == pytest.approx(40e-6, rel=1e-12)
    assert domain.copies * boundary_length(domain, "free") == pytest.approx(
        9 * np.pi * 1e-6, rel=1e-5
    )


@pytest.mark.parametrize("symmetry", ["full", "quarter", "twelfth"])
def test_area_of_a_perforated_hexagon_matches_the_closed_form(
    devices: dict[str, Model], symmetry: str
) -> None:
    domain = mesh(devices["perforated hexagon"], symmetry, 2)
    assert area(domain) == pytest.approx(1.5 * 3**0.5 * 36e-12 - 13 * np.pi * 0.25e-12, rel=1e-8)


def test_the_error_of_a_circles_area_falls_as_the_fourth_power_of_the_edge_length(
    device: Device,
) -> None:
    errors = [area(mesh(device(CIRCLE), "quarter", r)) / (np.pi * 25e-12) - 1 for r in (0.5, 1.0)]
    rate = np.log2(abs(errors[0] / errors[1]))
    assert 3.7 < rate < 4.5
    assert abs(errors[1]) < 1e-6


@pytest.mark.parametrize(("symmetry", "count"), [("full", 9), ("quarter", 4)])
def test_edges_at_round_holes_are_arcs_of_them_and_all_others_are_straight(
    devices: dict[str, Model], symmetry: str, count: int
) -> None:
    model = devices["perforated square"]
    grid = mesh(model, symmetry, 0.5).mesh
    ends = np.moveaxis(grid.p[:, grid.facets], 0, -1)
    middles = grid.doflocs[:, grid.nvertices :].T
    free = grid.boundaries["free"]
    away = np.linalg.norm(middles[free][:, None] - model.holes.centres, axis=2)
    hole = away.argmin(axis=1)
    assert len(set(hole)) == count
    assert away.min(axis=1) == pytest.approx(0.5e-6, rel=1e-9)
    halves = np.linalg.norm(ends[:, free] - middles[free], axis=2)
    assert halves[0] == pytest.approx(halves[1], rel=1e-6)
    straight = np.setdiff1d(np.arange(len(middles)), free)
    np.testing.assert_allclose(middles[straight], ends[:, straight].mean(axis=0), atol=1e-17)


@pytest.mark.parametrize(
    ("name", "wedge"),
    [
        ("square", np.pi / 2),
        ("perforated square", np.pi / 2),
        ("perforated hexagon", np.pi / 2),
        ("perforated circle", np.pi / 2),
    ],
)
def test_the_symmetry_of_a_device_is_found(
    devices: dict[str, Model], name: str, wedge: float
) -> None:
    assert mesh(devices[name], resolution=0.3).wedge == wedge


def test_a_missing_or_moved_hole_ends_the_symmetry(devices: dict[str, Model]) -> None:
    model = devices["perforated square"]
    centres = model.holes.centres
    corner = np.argmax(centres.sum(axis=1))
    without = replace(model, holes=Holes(np.delete(centres, corner, axis=0), model.holes.radius))
    assert not has_symmetry(without, np.pi / 2)
    assert has_symmetry(without, 2 * np.pi)
    moved = centres.copy()
    moved[corner] += [0.01e-6, 0]
    assert not has_symmetry(replace(model, holes=Holes(moved, model.holes.radius)), np.pi)


def test_an_edge_that_is_free_on_one_side_only_ends_the_symmetry(device: Device) -> None:
    points = 'points = [["0 um", "-1 um"], ["4 um", "-1 um"], ["4 um", "1 um"], ["0 um", "1 um"]]'
    assert has_symmetry(device(f'kind = "polygon"\n{points}\nfree = [2]'), np.pi)
    assert has_symmetry(device(f'kind = "polygon"\n{points}\nfree = [1, 3]'), np.pi)
    assert not has_symmetry(device(f'kind = "polygon"\n{points}\nfree = [1]'), np.pi)


@pytest.mark.parametrize(
    ("symmetry", "resolution", "message"),
    [
        ("quater", 1.0, 'symmetry = "quater": expected auto, full, half, quarter, eighth, twelfth'),
        (
            "twelfth",
            1.0,
            'symmetry = "twelfth": outline and holes of device do not have it; use auto or full',
        ),
        ("auto", 0.0, "resolution = 0: expected a number from 0.1 to 20"),
        ("auto", float("nan"), "resolution = nan: expected a number from 0.1 to 20"),
    ],
)
def test_bad_arguments_give_one_line_with_the_remedy(
    device: Device, symmetry: str, resolution: float, message: str
) -> None:
    with pytest.raises(ParameterError) as caught:
        mesh(device(SQUARE), symmetry, resolution)
    assert str(caught.value) == message


def test_a_film_that_hangs_on_nothing_is_refused(device: Device) -> None:
    model = device(SQUARE)
    loose = replace(
        model,
        outline=replace(
            model.outline, segments=tuple(replace(s, clamped=False) for s in model.outline.segments)
        ),
    )
    with pytest.raises(GeometryError, match="no edge of the outline is clamped"):
        mesh(loose)


def test_meshes_are_the_same_to_the_last_bit(devices: dict[str, Model]) -> None:
    first, second = (mesh(devices["perforated hexagon"], "full", 0.5).mesh for _ in range(2))
    np.testing.assert_array_equal(first.doflocs, second.doflocs)
    np.testing.assert_array_equal(first.t, second.t)


def test_the_mesher_is_closed_after_a_mesh_and_after_a_failure(device: Device) -> None:
    mesh(device(SQUARE), resolution=0.3)
    assert not gmsh.isInitialized()
    crossed = tuple(
        Segment(a, b)
        for a, b in [
            ((0, 0), (1e-6, 1e-6)),
            ((1e-6, 1e-6), (1e-6, 0)),
            ((1e-6, 0), (0, 1e-6)),
            ((0, 1e-6), (0, 0)),
        ]
    )
    with pytest.raises(GeometryError, match="encloses no film"):
        mesh(replace(device(SQUARE), outline=Outline("polygon", crossed, None, 1e-6)), "full")
    assert not gmsh.isInitialized()


@pytest.mark.parametrize(
    ("places", "line"),
    [
        ([(0, 0), (0.4, 0)], r"hole 1 at \(0, 0\) um and hole 2 at \(0.4, 0\) um overlap"),
        ([(0, 0), (4.8, 0)], r"hole 2 at \(4.8, 0\) um of radius 0.5 um cuts the outline"),
        ([(7, 0)], r"hole 1 at \(7, 0\) um of radius 0.5 um lies outside the outline"),
    ],
)
def test_holes_that_are_moved_onto_others_are_refused(
    device: Device, places: list[tuple[float, float]], line: str
) -> None:
    with pytest.raises(GeometryError, match=line):
        mesh(replace(device(SQUARE), holes=holes_at(*places)), "full")


def test_an_opening_that_is_moved_onto_the_outline_or_a_hole_is_refused(device: Device) -> None:
    model = slender(device, 2.0)
    (opening,) = model.openings
    onto_edge = replace(model, openings=(placed(opening, np.array([4e-6, 0.0])),))
    with pytest.raises(GeometryError, match=r"opening 1 at \(4.3, 0.5\) um .* cuts or touches"):
        mesh(onto_edge, "full")
    with pytest.raises(
        GeometryError, match=r"opening 1 .* and the round hole 1 .* overlap or touch"
    ):
        mesh(replace(model, holes=holes_at((0.3, 1.0))), "full")


def slender(device: Device, aspect: float, angle: float = 0.0, bending: bool = True) -> Model:
    """A square with one elliptical opening."""
    hole = (
        'lattice = "list"\ncentres = [["0.3 um", "0.5 um"]]\n'
        f'semi_axes = ["1.5 um", "{1.5 / aspect:.6g} um"]\nangle = "{angle} deg"\n'
    )
    return replace(device(SQUARE, hole), bending=bending)


@pytest.mark.parametrize(
    "aspect",
    [
        1.3,
        pytest.param(2.0, marks=pytest.mark.slow),
        pytest.param(5.0, marks=pytest.mark.slow),
        10.0,
    ],
)
def test_edges_along_an_ellipse_leave_it_by_little_anywhere(device: Device, aspect: float) -> None:
    domain = mesh(slender(device, aspect, 20.0), "full")
    rim = Space(domain.mesh, 4).arc_nodes
    (opening,) = domain.model.openings
    gaps = curves.distance(opening, rim) / (1.5e-6 / aspect)
    assert domain.misfit == pytest.approx(gaps.max(), rel=0.02)
    # Edges of the tip's size all around leave 3e-4 of aspects 1.3 and 2
    assert gaps.max() < 1.5e-4


def test_slender_ellipses_take_few_elements_but_without_bending(device: Device) -> None:
    elements = {
        (aspect, bending): mesh(slender(device, aspect, 20.0, bending), "full").mesh.nelements
        for aspect in (2.0, 10.0)
        for bending in (True, False)
    }
    assert elements[10.0, True] - elements[2.0, True] < 800
    assert elements[10.0, False] - elements[2.0, False] > 2000


@pytest.mark.parametrize("angle", [0.0, 40.0])
def test_first_order_distances_from_an_ellipse(angle: float) -> None:
    whole = Outline("ellipse", ellipse((1.0, -2.0), (3.0, 0.5), angle), None, 6.0)
    arc = whole.segments[0]
    points = curves.point_at(arc, np.linspace(0.05, 0.95, 9)) + np.array([1e-5, 2e-5])
    alone = Outline("arc", (arc,), None, 6.0)
    assert curves.gaps_from_ellipse(arc, points) == pytest.approx(
        curves.distance(alone, points), rel=1e-3
    )
    beyond = curves.point_at(whole.segments[2], 0.5)[None]
    assert np.isinf(curves.gaps_from_ellipse(arc, beyond)).all()


def test_openings_of_a_whole_film_are_meshed_as_those_of_its_half() -> None:
    holes = (
        '[[holes]]\nlattice = "square"\npitch = "3 um"\ncount = [2, 1]\nradius = "0.5 um"\n'
        '[[holes]]\nlattice = "list"\ncentres = [["0 um", "0 um"]]\nclamped = true\n'
        'radius = "0.4 um"\n'
        '[[holes]]\nlattice = "list"\ncentres = [["3.2 um", "0 um"]]\n'
        'shape = {kind = "square", side = "1 um", fillet = "0.2 um"}\n'
    )
    text = f'name = "mixed"\nsource = "a test"\n[outline]\n{SQUARE}\n{holes}[film]\n{THIN}\n'
    found = {word: mesh(parse(text), word) for word in ("full", "half")}
    assert area(found["full"]) == pytest.approx(area(found["half"]), rel=1e-6)
    # Of two circles and a rounded square, and of the outline and a post; chords are shorter
    known = {
        "free": 2 * np.pi * 2 * 0.5e-6 + 4 * 0.6e-6 + 2 * np.pi * 0.2e-6,
        "clamped": 40e-6 + 2 * np.pi * 0.4e-6,
    }
    for word, copies in (("full", 1), ("half", 2)):
        grid = found[word].mesh
        for name, length in known.items():
            ends = grid.p[:, grid.facets[:, grid.boundaries[name]]]
            drawn = copies * np.hypot(*(ends[:, 0] - ends[:, 1])).sum()
            assert drawn == pytest.approx(length, rel=0.02), (word, name)


def test_curved_triangles_that_fold_over_are_refused(device: Device) -> None:
    grid: MeshTri2 = MeshTri2.from_mesh(MeshTri1.init_symmetric())
    check_unfolded(device(SQUARE), grid)
    points = np.array(grid.doflocs)
    facet = grid.boundary_facets()[0]
    middle = points[:, grid.nvertices + facet]
    # Pulled past the middle of its triangle
    points[:, grid.nvertices + facet] += 1.2 * (0.5 - middle)
    with pytest.raises(GeometryError, match=r"1 curved elements fold over.*raise the resolution"):
        check_unfolded(device(SQUARE), MeshTri2(points, grid.t))


def test_nine_hundred_holes_are_meshed_with_shapely_triangles() -> None:
    domain = mesh(load("square-270um-perforated"))
    # One hole more or less: 3.5e-5
    assert area(domain) == pytest.approx(270e-6**2 - 900 * np.pi * 0.81e-12, rel=1e-5)
    corners = np.asarray(domain.mesh.p)[:, domain.mesh.t]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=0)
    first = corners[:, 1] - corners[:, 0]
    second = corners[:, 2] - corners[:, 0]
    shape = (
        2 * 3**0.5 * np.abs(first[0] * second[1] - first[1] * second[0]) / np.sum(sides**2, axis=0)
    )
    assert shape.min() > 0.3  # 1 for an equilateral triangle


@pytest.mark.parametrize("layer", [1e-2, 1e-3])
def test_triangles_at_a_clamped_edge_are_as_small_as_the_bending_layer_all_along(
    device: Device, layer: float
) -> None:
    film = Film(1e-9, 12 * (layer * 1e-6) ** 2 / 1e-18, 0.0, 1.0, 1.0)
    model = replace(device('kind = "square"\nside = "1 um"'), bending=True, film=film)
    assert bending_length(model) == pytest.approx(layer * 1e-6)
    domain = mesh(model)
    facets = Space(domain.mesh, 1).boundary_facets("clamped")
    ends = np.asarray(domain.mesh.p)[:, domain.mesh.facets[:, facets]]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=0)
    assert lengths.max() < 2.5 * layer * 1e-6
    assert lengths.min() > 0.8 * layer * 1e-6


@pytest.mark.parametrize(("symmetry", "copies"), [("half", 2), ("full", 1)])
def test_each_arc_is_divided_by_its_own_radius(device: Device, symmetry: str, copies: int) -> None:
    # A stadium of one large and one small half circle, joined by its common tangents.
    slope = np.arcsin(0.9 / 4)
    normal = np.array([np.sin(slope), np.cos(slope)])
    large = np.array([-2.0, 0.0])
    small = np.array([2.0, 0.0])
    p = large + normal
    q = small + 0.1 * normal
    corners = [
        (p * [1, -1], q * [1, -1], None),
        (q * [1, -1], q, small),
        (q, p, None),
        (p, p * [1, -1], large),
    ]
    segments = tuple(
        Segment(tuple(a), tuple(b), None if c is None else tuple(c)) for a, b, c in corners
    )
    domain = mesh(
        replace(device(SQUARE), outline=Outline("stadium", segments, None, 5.1)), symmetry, 1
    )
    grid = domain.mesh
    facets = Space(grid, 1).boundary_facets("clamped")
    middle = np.asarray(grid.doflocs)[:, grid.nvertices + facets].T
    round_ends = [
        np.abs(np.linalg.norm(middle - c, axis=1) - r) < 1e-6
        for c, r in ((large, 1.0), (small, 0.1))
    ]
    assert 30 < copies * round_ends[0].sum() < 60
    assert 20 < copies * round_ends[1].sum() < 60


@pytest.mark.parametrize("gap", [0.02, 0.1])
def test_elements_in_a_web_between_two_holes_are_no_longer_than_it_is_wide(
    gap: float, device: Device
) -> None:
    model = device(SQUARE)
    radius = 0.1 * model.outline.length
    apart = radius * (2 + gap)
    holes = Holes(np.array([[-apart / 2, 0.0], [apart / 2, 0.0]]), radius)
    made = mesh(replace(model, holes=holes), "full").mesh
    x, y = made.p[:, made.t].mean(axis=1)
    within = np.hypot(x, y) < gap * radius
    corners = made.p[:, made.t[:, within]]
    longest = max(
        np.hypot(*(corners[:, a] - corners[:, b])).max() for a, b in combinations(range(3), 2)
    )
    assert within.sum() > 1
    assert longest < 1.5 * gap * radius


@pytest.mark.parametrize("resolution", [1, 2])
def test_round_rims_have_twelve_elements_each_and_more_beside_a_narrow_web(resolution: int) -> None:
    alone = [(-3.0, 3.0, 0.5), (0.0, 3.0, 0.53), (3.0, 3.0, 0.58), (0.0, 0.0, 0.7)]
    pair = [(-1.0, -3.0, 0.95), (1.0, -3.0, 0.96)]
    text = f'name = "circles"\nsource = "a test"\n[outline]\n{SQUARE}\n[film]\n{THIN}\n'
    for x, y, r in alone + pair:
        centre = f'centres = [["{x} um", "{y} um"]]'
        text += f'[[holes]]\nlattice = "list"\n{centre}\nradius = "{r} um"\n'
    grid = mesh(parse(text), "full", resolution).mesh
    middles = 1e6 * grid.doflocs[:, grid.nvertices + grid.boundaries["free"]].T

    def around(x: float, y: float, r: float) -> int:
        """Return how many elements a rim has."""
        return int(np.sum(np.abs(np.hypot(*(middles - [x, y]).T) - r) < 1e-3))

    assert [around(*rim) for rim in alone] == [12 * resolution] * len(alone)
    assert min(around(*rim) for rim in pair) > 16 * resolution


@pytest.mark.parametrize("width", [2, 4, 6])
def test_a_web_between_holes_is_refined_in_step_with_all_else(width: int) -> None:
    text = (resources.geometries() / "square-270um.toml").read_text(encoding="utf-8")
    away = 10 + width / 2
    holes = f'centres = [["{away} um", "30 um"], ["-{away} um", "30 um"]]\nradius = "10 um"\n'
    model = parse(f'{text}\n[holes]\nlattice = "list"\n{holes}')

    def length(resolution: float) -> float:
        """Return the mean length [m] of edges in the web."""
        found = mesh(model, "full", resolution).mesh
        middle = found.p[:, found.t].mean(axis=1)
        near = np.hypot(middle[0], middle[1] - 30e-6) < width * 0.5e-6
        sides = found.p[:, found.t[1]] - found.p[:, found.t[0]]
        return float(np.linalg.norm(sides, axis=0)[near].mean())

    assert length(2.0) < 0.6 * length(1.0)


def test_a_reader_that_goes_after_meshing_does_not_end_the_process() -> None:
    program = """
import os
from femnl import load
from femnl.device.mesh import mesh

mesh(load("square-270um"), resolution=0.2)
reader, writer = os.pipe()
os.close(reader)
try:
    os.write(writer, b"a line")
except BrokenPipeError:
    print("told")
"""
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (told.returncode, told.stdout) == (0, "told\n"), told.stderr
