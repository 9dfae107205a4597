"""Ellipses, fillets, arcs and inner edges: their measures, their meshes, and what they become."""

from math import asin, pi, sqrt

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ellipe

from femnl.core.device import Model
from femnl.core.errors import GeometryError, ParameterError
from femnl.core.outline import Outline
from femnl.device.geometry import curves, parse
from femnl.device.geometry.reader import describe
from femnl.device.mesh import has_symmetry, mesh
from femnl.device.mesh.symmetry import HALF, QUARTER, TWELFTH
from femnl.mechanics.bands import Lattice, solve_bands
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import thickness
from femnl.mechanics.lattice import obstacle
from femnl.plot.notebook import draw

Array = NDArray[np.float64]

FILM = (
    '[film]\nthickness = "1 um"\nyoung = "250 GPa"\npoisson = 0.23\ndensity = "1 kg/m^3"\n'
    'stress = "1 Pa"\n'
)
CIRCLE = 'kind = "circle"\ndiameter = "2 m"'
L = (
    'kind = "polygon"\npoints = [["0 m", "0 m"], ["2 m", "0 m"], ["2 m", "1 m"], ["1 m", "1 m"], '
    '["1 m", "2 m"], ["0 m", "2 m"]]'
)
QUARTER_TURN = 1 - pi / 4  # of a corner of 90° that a fillet of radius 1 takes
OUTLINES = {
    'kind = "ellipse"\nwidth = "2 m"\nheight = "1 m"': pi / 2,
    'kind = "ellipse"\nwidth = "0.2 m"\nheight = "1 m"': pi / 20,
    'kind = "square"\nside = "1 m"\nfillet = "0.1 m"': 1 - 4 * QUARTER_TURN * 0.01,
    'kind = "rectangle"\nwidth = "2 m"\nheight = "1 m"\nfillet = "0.5 m"': 1 + pi / 4,
    'kind = "regular-polygon"\nsides = 6\nlong_axis = "2 m"\nfillet = "0.2 m"': 1.5 * sqrt(3)
    - 0.04 * (2 * sqrt(3) - pi),
    f'{L}\nfillet = "0.2 m"': 3 - 4 * QUARTER_TURN * 0.04,
    f'{L}\nfillet = ["0 m", "0 m", "0 m", "0.5 m", "0 m", "0 m"]': 3 + QUARTER_TURN * 0.25,
    f'{L}\narcs = [{{edge = 1, through = ["1 m", "-1 m"]}}]': 3 + pi / 2,
    'kind = "polygon"\npoints = [["-1 m", "0 m"], ["-1 m", "2 m"], ["1 m", "2 m"], ["1 m", "0 m"]]'
    '\narcs = [{edge = 4, through = ["0 m", "0.5 m"]}]': 4 - (1.5625 * asin(0.8) - 0.75),
}


def device(outline: str, holes: str = "", film: str = FILM) -> Model:
    return parse(f'name = "any"\n[outline]\n{outline}\n{holes}\n{film}[model]\nbending = false\n')


def listed(shape: str, *centres: tuple[float, float]) -> str:
    places = ", ".join(f'["{x} m", "{y} m"]' for x, y in centres)
    return f'[[holes]]\nlattice = "list"\ncentres = [{places}]\n{shape}\n'


def covered(model: Model) -> float:
    """The area of the mesh [m²]."""
    domain = mesh(model)
    space = Space(domain.mesh, 2)
    points, weights = space.quadrature(8)
    determinant = np.linalg.det(space.jet(slice(None), points).jacobian)
    assert np.all(determinant * np.sign(determinant[:, :1]) > 0)
    return float(domain.copies * np.sum(np.abs(determinant) * weights))


def length(outline: Outline) -> float:
    line = curves.polyline(outline, 20_000)
    return float(np.sum(np.hypot(*np.diff(line, axis=0).T)))


@pytest.mark.parametrize(("outline", "area"), OUTLINES.items())
def test_outlines_and_their_meshes_have_the_area_of_their_closed_form(
    outline: str, area: float
) -> None:
    model = device(outline)
    assert curves.area(model.outline) == pytest.approx(area, rel=1e-12)
    assert covered(model) == pytest.approx(area, rel=2e-7)


@pytest.mark.parametrize("outline", OUTLINES)
def test_an_outline_is_closed_smooth_and_the_same_to_every_measure(outline: str) -> None:
    shape = device(outline).outline
    after = shape.segments[1:] + shape.segments[:1]
    assert all(a.end == b.start for a, b in zip(shape.segments, after, strict=True))
    rng = np.random.default_rng(1)
    x0, y0, x1, y1 = curves.box(shape)
    points = rng.uniform([x0 - 0.1, y0 - 0.1], [x1 + 0.1, y1 + 0.1], (4000, 2))
    fine = curves.polyline(shape, 20_000)
    assert np.abs([fine.min(axis=0) - [x0, y0], fine.max(axis=0) - [x1, y1]]).max() < 1e-7
    fractions = np.array([0.2, 0.5, 0.8])
    on = np.concatenate([curves.point_at(s, fractions) for s in shape.segments])
    assert curves.distance(shape, on).max() < 1e-12
    ahead = np.concatenate([curves.point_at(s, fractions + 1e-7) for s in shape.segments]) - on
    left = 1e-6 * np.stack([-ahead[:, 1], ahead[:, 0]], 1) / np.hypot(*ahead.T)[:, None]
    assert curves.contains(shape, on + left).all()
    assert not curves.contains(shape, on - left).any()
    np.testing.assert_allclose(curves.distance(shape, on + left), 1e-6, rtol=1e-4)
    share = curves.contains(shape, points).mean() * (x1 - x0 + 0.2) * (y1 - y0 + 0.2)
    assert share == pytest.approx(curves.area(shape), rel=0.05)


def test_fillets_leave_no_corners_and_sharp_ones_stay() -> None:
    assert device('kind = "square"\nside = "1 m"\nfillet = "0.1 m"').outline.corners == ()
    some = device(f'{L}\nfillet = ["0 m", "0 m", "0 m", "0.5 m", "0 m", "0 m"]').outline
    assert len(some.corners) == 5
    assert max(angle for _, angle in some.corners) == pytest.approx(pi / 2)


def test_an_ellipse_has_the_length_of_legendres_integral() -> None:
    shape = device('kind = "ellipse"\nwidth = "2 m"\nheight = "1 m"').outline
    assert length(shape) == pytest.approx(4 * float(ellipe(0.75)), rel=1e-7)


@pytest.mark.parametrize("seed", range(3))
def test_distances_from_ellipses_agree_with_a_fine_polyline(seed: int) -> None:
    rng = np.random.default_rng(seed)
    width, height = rng.uniform(0.1, 2, 2)
    shape = device(f'kind = "ellipse"\nwidth = "{width} m"\nheight = "{height} m"').outline
    points = rng.uniform(-1.2, 1.2, (300, 2))
    fine = curves.polyline(shape, 40_000)
    least = [np.hypot(*(fine - point).T).min() for point in points]
    np.testing.assert_allclose(
        curves.distance(shape, points), least, atol=1e-4 * max(width, height)
    )


def test_a_polygon_walked_backwards_is_the_same_film() -> None:
    forwards = device(f'{L}\nfillet = ["0 m", "0.1 m", "0 m", "0.3 m", "0 m", "0 m"]').outline
    backwards = device(
        'kind = "polygon"\npoints = [["0 m", "2 m"], ["1 m", "2 m"], ["1 m", "1 m"], '
        '["2 m", "1 m"], ["2 m", "0 m"], ["0 m", "0 m"]]\n'
        'fillet = ["0 m", "0 m", "0.3 m", "0 m", "0.1 m", "0 m"]'
    ).outline
    assert curves.area(backwards) == pytest.approx(curves.area(forwards), rel=1e-12)
    points = curves.polyline(backwards)
    assert curves.distance(forwards, points).max() < 1e-12


def test_an_annulus_on_a_post_is_clamped_at_both_rims() -> None:
    model = device(CIRCLE, listed('radius = "0.3 m"\nclamped = true', (0, 0)))
    assert len(model.holes.centres) == 0
    (post,) = model.openings
    assert post.kind == "circle"
    assert all(s.clamped for s in post.segments)
    domain = mesh(model)
    edges = domain.mesh.boundaries or {}
    assert "free" not in edges
    rim = domain.mesh.p[:, domain.mesh.facets[:, edges["clamped"]]]
    radii = np.hypot(*rim)
    np.testing.assert_allclose(radii[radii < 0.65], 0.3, rtol=1e-9)
    np.testing.assert_allclose(radii[radii > 0.65], 1.0, rtol=1e-9)
    assert covered(model) == pytest.approx(pi * (1 - 0.09), rel=1e-6)


def test_groups_of_holes_become_a_lattice_and_openings() -> None:
    holes = (
        '[[holes]]\nlattice = "square"\npitch = "0.2 m"\ncount = [3, 3]\nradius = "0.04 m"\n'
        + listed('radius = ["0.1 m", "0.05 m"]', (0.6, 0), (-0.6, 0))
        + listed('semi_axes = ["0.2 m", "0.05 m"]\nangle = "30 deg"', (0, 0.6))
        + listed('radius = "0.1 m"\nclamped = true', (0, -0.6))
    )
    model = device(CIRCLE, holes)
    assert len(model.holes.centres) == 9
    assert [o.kind for o in model.openings] == ["circle", "circle", "ellipse", "circle"]
    assert "9 holes of radius 4e+04 µm and 4 openings" in describe(model)
    taken = 9 * pi * 0.0016 + pi * (0.01 + 0.0025) + pi * 0.01 + pi * 0.01
    assert covered(model) == pytest.approx(pi - taken, rel=1e-5)
    edges = mesh(model).mesh.boundaries or {}
    assert set(edges) == {"clamped", "free"}
    assert len(draw(model).axes[0].patches) == 5


def test_one_table_of_like_holes_is_what_it_was() -> None:
    group = 'lattice = "list"\ncentres = [["0 m", "0 m"], ["0.5 m", "0 m"]]\nradius = "0.1 m"\n'
    one = device(CIRCLE, f"[holes]\n{group}")
    other = device(CIRCLE, f"[[holes]]\n{group}")
    assert not one.openings
    assert not other.openings
    np.testing.assert_array_equal(one.holes.centres, other.holes.centres)


@pytest.mark.parametrize(
    ("shape", "centres", "symmetry"),
    [
        ('radius = "0.1 m"', [(0, 0)], (True, True)),
        ('radius = "0.1 m"\nclamped = true', [(0.3, 0), (-0.3, 0)], (True, True)),
        ('radius = ["0.1 m", "0.2 m"]', [(0.4, 0), (-0.4, 0)], (True, False)),
        ('semi_axes = ["0.3 m", "0.1 m"]', [(0, 0)], (True, True)),
        ('semi_axes = ["0.3 m", "0.1 m"]\nangle = "30 deg"', [(0, 0)], (False, False)),
        ('semi_axes = ["0.3 m", "0.1 m"]\nangle = "90 deg"', [(0.5, 0)], (True, False)),
    ],
)
def test_openings_keep_the_mirrors_that_they_have(
    shape: str, centres: list[tuple[float, float]], symmetry: tuple[bool, bool]
) -> None:
    model = device(CIRCLE, listed(shape, *centres))
    assert (has_symmetry(model, HALF), has_symmetry(model, QUARTER)) == symmetry


def test_one_clamped_and_one_free_opening_are_no_mirror_images() -> None:
    holes = listed('radius = "0.1 m"\nclamped = true', (0.4, 0)) + listed(
        'radius = ["0.1 m"]', (-0.4, 0)
    )
    model = device(CIRCLE, holes)
    assert has_symmetry(model, HALF)
    assert not has_symmetry(model, QUARTER)


def test_a_ring_of_holes_of_two_radii_has_the_mirrors_of_the_hexagon() -> None:
    angle = np.pi / 3 * np.arange(6)
    ring = [(round(0.5 * np.cos(a), 9), round(0.5 * np.sin(a), 9)) for a in angle]
    hexagon = 'kind = "regular-polygon"\nsides = 6\nlong_axis = "2 m"'
    radii = ", ".join(6 * ['"0.1 m"'] + ['"0.2 m"'])
    model = device(hexagon, listed(f"radius = [{radii}]", *ring, (0, 0)))
    assert has_symmetry(model, TWELFTH)


def test_the_film_thins_towards_holes_of_any_radius_and_not_towards_posts() -> None:
    film = FILM.replace("1 um", '1 um"\ntaper = "0.5 um"\ntaper_length = "0.1 m')
    holes = listed('radius = ["0.1 m", "0.2 m"]', (0.5, 0), (-0.5, 0)) + listed(
        'radius = "0.1 m"\nclamped = true', (0, 0.6)
    )
    model = device(CIRCLE, holes, film)
    at = np.array([[0.6, 0.0], [0.65, 0.0], [-0.3, 0.0], [0.0, 0.5]])
    np.testing.assert_allclose(thickness(model, at), [0.5e-6, 0.75e-6, 0.5e-6, 1e-6], rtol=1e-9)
    with pytest.raises(GeometryError, match=r"\[film\] taper = 500 nm: it is known around round"):
        device(CIRCLE, listed('semi_axes = ["0.1 m", "0.2 m"]', (0, 0)), film)
    with pytest.raises(GeometryError, match="there are no holes to thin the film around"):
        device(CIRCLE, listed('radius = "0.1 m"\nclamped = true', (0, 0)), film)


def test_openings_and_fillets_are_no_lattice() -> None:
    lattice = '[[holes]]\nlattice = "square"\npitch = "0.2 m"\ncount = [4, 4]\nradius = "0.04 m"\n'
    square = 'kind = "square"\nside = "1 m"'
    assert not obstacle(device(square, lattice))
    assert "sharp corners" in obstacle(device(f'{square}\nfillet = "0.1 m"', lattice))
    post = lattice + listed('radius = "0.02 m"\nclamped = true', (0, 0))
    assert "all round, free and of one radius" in obstacle(device(square, post))
    posts = lattice.replace('"0.04 m"', '"0.04 m"\nclamped = true')
    with pytest.raises(ParameterError, match="bands need a lattice whose holes are all free"):
        solve_bands(device(square, posts), 2)
    given = Lattice("square", 0.2)
    with pytest.raises(ParameterError, match="that is given takes holes that are all round"):
        solve_bands(device(square, post), 2, lattice=given)


def test_an_etched_film_takes_one_group_of_like_holes() -> None:
    with pytest.raises(GeometryError, match=r'\[holes\] kind = "etched" takes one group'):
        device('kind = "etched"\netch_radius = "0.5 m"', listed('radius = ["0.1 m"]', (0, 0)))


def test_an_overhang_follows_a_fillet_with_one_centre() -> None:
    model = device(
        'kind = "square"\nside = "1 m"\nfillet = "0.1 m"', '[overhang]\nwidth = "0.05 m"'
    )
    rim = model.edge_outline
    assert curves.area(rim) == pytest.approx(1.21 - 4 * QUARTER_TURN * 0.0225, rel=1e-12)
    on = curves.polyline(model.outline)
    np.testing.assert_allclose(curves.distance(rim, on), 0.05, rtol=1e-9)
