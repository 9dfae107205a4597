"""Modes of films: rates, symmetry, degenerate pairs, labels and shapes."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import jn_zeros, jv
from skfem import MeshTri1, MeshTri2

from femnl import load
from femnl.core.device import Model
from femnl.core.domain import Domain
from femnl.core.errors import ConvergenceError, ParameterError
from femnl.core.modes import Modes
from femnl.core.outline import Holes, Outline, Segment
from femnl.device.mesh import mesh
from femnl.mechanics.modes import align, shape_at, solve_modes
from femnl.mechanics.modes.operators import Operators
from femnl.mechanics.modes.solve import DEGENERATE
from femnl.mechanics.prestress import solve_prestress

Array = NDArray[np.float64]
Device = Callable[..., Model]

SQUARE = 'kind = "square"\nside = "1 m"'
NEARLY_SQUARE = 'kind = "rectangle"\nwidth = "1 m"\nheight = "1.001 m"'
HEXAGON = 'kind = "regular-polygon"\nsides = 6\nlong_axis = "2 m"'
CIRCLE = 'kind = "circle"\ndiameter = "2 m"'


def solve(
    model: Model, count: int, symmetry: str = "auto", resolution: float = 1.0, degree: int = 4
) -> Modes:
    return solve_modes(solve_prestress(mesh(model, symmetry, resolution), degree), count, degree)


def wave_speed(model: Model) -> float:
    return float(np.sqrt(model.film.stress / model.film.density))


def perforated(model: Model, radius: float = 0.05) -> Model:
    """A square lattice of 5 × 5 holes with one at the origin and some on every mirror line."""
    centres = 0.15 * np.array([(i, j) for i in range(-2, 3) for j in range(-2, 3)])
    return replace(model, holes=Holes(centres, radius))


def turned(model: Model, angle: float) -> Model:
    """The same film turned about the origin, so that no mirror line is left on the axes."""
    c = np.cos(angle)
    s = np.sin(angle)

    def turn(x: float, y: float) -> tuple[float, float]:
        return (c * x - s * y, s * x + c * y)

    segments = tuple(Segment(turn(*g.start), turn(*g.end)) for g in model.outline.segments)
    holes = Holes(
        np.array([turn(x, y) for x, y in model.holes.centres]).reshape(-1, 2), model.holes.radius
    )
    return replace(
        model, outline=Outline("polygon", segments, None, model.outline.length), holes=holes
    )


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_square_membrane_eigenvalue_error_falls_as_h_to_twice_the_degree(
    device: Device, degree: int
) -> None:
    model = device(SQUARE)
    errors = []
    exact = 2 * (np.pi * wave_speed(model)) ** 2
    for level in (2, 3, 4):
        linear = MeshTri1.init_sqsymmetric().refined(level)
        grid = MeshTri2.from_mesh(MeshTri1(np.asarray(linear.p) - 0.5, linear.t))
        domain = Domain(
            model,
            grid.with_boundaries({"clamped": lambda x: np.full(x.shape[1:], True)}),
            2 * np.pi,
        )
        frequency = solve_modes(solve_prestress(domain, degree), 1, degree).frequency[0]
        errors.append((2 * np.pi * frequency) ** 2 / exact - 1)
    assert all(error > 0 for error in errors)
    assert [np.log2(a / b) for a, b in pairwise(errors)] == pytest.approx(
        [2 * degree] * 2, abs=0.15
    )


def test_the_circles_eigenvalues_are_squares_of_bessel_zeros(device: Device) -> None:
    model = device(CIRCLE)
    modes = solve(model, 6, resolution=3)
    zeros = np.sort(
        np.concatenate([jn_zeros(0, 2), *(np.repeat(jn_zeros(m, 2), 2) for m in (1, 2, 3))])
    )[:6]
    np.testing.assert_allclose(2 * np.pi * modes.frequency / wave_speed(model), zeros, rtol=3e-9)


def test_a_turned_rectangle_without_mirror_lines_on_the_axes_has_the_same_modes(
    device: Device,
) -> None:
    straight = device('kind = "rectangle"\nwidth = "3 m"\nheight = "2 m"')
    model = turned(straight, 0.2)
    modes = solve(model, 6, resolution=1.5)
    assert modes.domain.copies == 1
    squares = np.sort([(m / 3) ** 2 + (n / 2) ** 2 for m in range(1, 6) for n in range(1, 6)])[:6]
    np.testing.assert_allclose(modes.frequency, wave_speed(model) / 2 * np.sqrt(squares), rtol=2e-7)


def test_a_right_isosceles_triangle_has_the_antisymmetric_modes_of_the_square(
    device: Device,
) -> None:
    model = device('kind = "polygon"\npoints = [["0 m", "0 m"], ["1 m", "0 m"], ["0 m", "1 m"]]')
    modes = solve(model, 4, resolution=2)
    squares = np.sort([m * m + n * n for m in range(1, 6) for n in range(1, m)])[:4]
    np.testing.assert_allclose(modes.frequency, wave_speed(model) / 2 * np.sqrt(squares), rtol=2e-7)


SYMMETRIES = [
    (SQUARE, ("half", "quarter")),
    (HEXAGON, ("half", "quarter")),
    (CIRCLE, ("quarter",)),
]


@pytest.mark.parametrize(("outline", "symmetries"), SYMMETRIES, ids=["square", "hexagon", "circle"])
@pytest.mark.parametrize("bending", [False, True])
def test_the_whole_film_and_its_wedges_have_the_same_modes(
    device: Device, outline: str, symmetries: tuple[str, ...], bending: bool
) -> None:
    model = perforated(device(outline))
    if bending:
        model = replace(model, bending=True, film=replace(model.film, thickness=1e-2))
    whole = solve(model, 6, "full", 0.7)
    for symmetry in symmetries:
        part = solve(model, 6, symmetry, 0.7)
        np.testing.assert_allclose(part.frequency, whole.frequency, rtol=1e-4)
        # Its antinode is the rim of a hole
        assert part.effective_mass[0] == pytest.approx(whole.effective_mass[0], rel=3e-3)


@pytest.mark.parametrize(
    ("outline", "symmetry"), [(SQUARE, "eighth"), (CIRCLE, "eighth"), (HEXAGON, "twelfth")]
)
def test_small_wedges_hold_the_modes_that_are_alone_in_their_symmetry(
    device: Device, outline: str, symmetry: str
) -> None:
    model = device(outline)
    all_modes = solve(model, 12, "quarter").frequency
    few = solve(model, 4, symmetry).frequency
    assert few[0] == pytest.approx(all_modes[0], rel=1e-6)
    assert all(np.abs(all_modes / f - 1).min() < 1e-5 for f in few if f < all_modes[-1])


@pytest.mark.parametrize(("outline", "pairs"), [(SQUARE, True), (NEARLY_SQUARE, False)])
def test_modes_are_orthogonal_in_mass_and_in_stiffness(
    device: Device, outline: str, pairs: bool
) -> None:
    model = perforated(device(outline))
    model = replace(model, bending=True, film=replace(model.film, thickness=1e-2))
    modes = solve(model, 8, "full", 0.7)
    operators = Operators(modes.prestress, 4)
    shapes = modes.shapes / np.sqrt(modes.effective_mass)[:, None]
    np.testing.assert_allclose(shapes @ (operators.mass @ shapes.T), np.eye(8), atol=1e-10)
    stiffness = shapes @ (operators.stiffness(()) @ shapes.T)
    square = (2 * np.pi * modes.frequency) ** 2
    np.testing.assert_allclose(np.diagonal(stiffness), square, rtol=1e-9)
    # A pair that the mesh splits by less than that is turned as one frequency's. A turn by φ leaves
    # (λ₂ − λ₁) sin φ cos φ between its modes, half the splitting at most.
    highest = np.maximum.outer(square, square)
    pair = np.abs(np.subtract.outer(square, square)) <= DEGENERATE * highest
    assert np.any(pair & ~np.eye(8, dtype=bool)) == pairs
    left = np.where(pair, DEGENERATE / 2 * highest, 0.0) + 1e-9 * stiffness.max()
    assert np.all(np.abs(stiffness - np.diag(square)) <= left)


def test_shapes_reach_one_and_nowhere_more(device: Device) -> None:
    modes = solve(device(HEXAGON), 6)
    x, y = np.random.default_rng(1).uniform(-1, 1, (2, 20000))
    for index in range(6):
        shape = shape_at(modes, index, x, y)
        assert 0.99 < np.abs(shape).max() <= 1 + 1e-6


@pytest.mark.parametrize("symmetry", ["full", "half", "quarter"])
def test_pairs_of_the_square_are_products_of_sines_with_x_first(
    device: Device, symmetry: str
) -> None:
    modes = solve(device(SQUARE), 11, symmetry, 1.5)
    expected = (
        "(1,1)",
        "(2,1)",
        "(1,2)",
        "(2,2)",
        "(3,1)",
        "(1,3)",
        "(3,2)",
        "(2,3)",
        "(4,1)",
        "(1,4)",
        "(3,3)",
    )
    assert modes.label == expected
    x, y = np.random.default_rng(2).uniform(-0.5, 0.5, (2, 50))
    for index, label in enumerate(expected):
        m = int(label[1])
        n = int(label[3])
        ideal = np.sin(m * np.pi * (x + 0.5)) * np.sin(n * np.pi * (y + 0.5))
        shape = shape_at(modes, index, x, y)
        np.testing.assert_allclose(shape * np.sign(shape @ ideal), ideal, atol=1e-3)


@pytest.mark.parametrize("symmetry", ["full", "half", "quarter"])
def test_pairs_of_the_circle_are_cosines_and_sines_of_the_angle(
    device: Device, symmetry: str
) -> None:
    modes = solve(device(CIRCLE), 8, symmetry, 1.5)
    r, angle = np.random.default_rng(3).random((2, 50)) * np.array([[1], [2 * np.pi]])
    # Order m, cosine or sine
    kinds = [(0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (0, 0), (3, 0), (3, 1)]
    for index, (m, odd) in enumerate(kinds):
        radial = jv(m, jn_zeros(m, 2)[1 if index == 5 else 0] * r)
        ideal = radial * (np.sin(m * angle) if odd else np.cos(m * angle))
        shape = shape_at(modes, index, r * np.cos(angle), r * np.sin(angle))
        overlap = shape @ ideal / np.sqrt((shape @ shape) * (ideal @ ideal))
        if m in (0, 1, 3):
            assert abs(overlap) == pytest.approx(1, abs=1e-6)
        else:  # both members of a pair of even m are told apart, in either order
            other = radial * (np.cos(m * angle) if odd else np.sin(m * angle))
            assert max(
                abs(overlap), abs(shape @ other) / np.sqrt((shape @ shape) * (other @ other))
            ) == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("symmetry", ["full", "half", "quarter"])
def test_pairs_of_the_hexagon_are_even_or_odd_about_both_axes(
    device: Device, symmetry: str
) -> None:
    modes = solve(device(HEXAGON), 10, symmetry, 1.5)
    x, y = np.random.default_rng(4).uniform(-0.6, 0.6, (2, 50))
    classes = []
    for index in range(10):
        shape, across, along = (
            shape_at(modes, index, sx * x, sy * y) for sx, sy in ((1, 1), (-1, 1), (1, -1))
        )
        parity = tuple(int(np.sign(shape @ image)) for image in (across, along))
        np.testing.assert_allclose(across, parity[0] * shape, atol=3e-4)
        np.testing.assert_allclose(along, parity[1] * shape, atol=3e-4)
        classes.append(parity)
    assert classes[1:3] == [(-1, 1), (1, -1)]  # along x first
    assert set(classes[3:5]) == {(1, 1), (-1, -1)}


def test_a_mode_at_the_end_of_the_list_is_not_torn_from_its_pair(device: Device) -> None:
    modes = solve(device(SQUARE), 5, "full")
    assert modes.label[4] == "(3,1)"


def test_no_mode_hides_behind_the_number_asked_for(device: Device) -> None:
    # All of the lowest modes of a long strip are in two of the four symmetry classes.
    model = device('kind = "rectangle"\nwidth = "12 m"\nheight = "1 m"')
    exact = wave_speed(model) / 2 * np.sqrt(1 + (np.arange(1, 21) / 12) ** 2)
    for count in (1, 2, 20):
        np.testing.assert_allclose(solve(model, count).frequency, exact[:count], rtol=1e-4)


def test_labels_follow_shapes_not_order(device: Device) -> None:
    modes = solve(device('kind = "rectangle"\nwidth = "3 m"\nheight = "1 m"'), 8)
    assert modes.label == ("(1,1)", "(2,1)", "(3,1)", "(4,1)", "(5,1)", "(1,2)", "(2,2)", "(6,1)")


def test_a_lattice_of_holes_couples_one_three_and_three_one_and_the_labels_say_so(
    device: Device,
) -> None:
    modes = solve(perforated(device(SQUARE)), 6, resolution=0.7)
    assert modes.label[:4] == ("(1,1)", "(2,1)", "(1,2)", "(2,2)")
    assert {modes.label[4], modes.label[5]} == {"(1,3)−(3,1)", "(1,3)+(3,1)"}
    assert abs(modes.frequency[5] / modes.frequency[4] - 1) > 1e-5


def test_shapes_without_a_box_have_no_labels(device: Device) -> None:
    assert solve(device(HEXAGON), 2).label == (None, None)


def test_shape_at_is_exactly_zero_outside_the_film_and_in_its_holes(device: Device) -> None:
    modes = solve(perforated(device(SQUARE)), 2, resolution=0.7)
    x = np.array([0.51, 0.7, 0.0, 0.0, 0.15, 0.12, 1e9])
    y = np.array([0.0, 0.7, -0.6, 0.0, 0.3, 0.0, 0.0])
    assert np.all(shape_at(modes, 0, x, y) == 0)
    assert shape_at(modes, 0, np.array(0.075), np.array(0.075)) > 0.5


@pytest.mark.parametrize("symmetry", ["full", "half", "quarter", "eighth"])
def test_shape_at_finds_every_point_of_a_strongly_graded_mesh(
    device: Device, symmetry: str
) -> None:
    model = replace(device(SQUARE), holes=Holes(np.zeros((1, 2)), 0.002))
    modes = solve(model, 1, symmetry, 0.5)
    x, y = np.random.default_rng(5).uniform(-0.499, 0.499, (2, 2000))
    near = np.random.default_rng(6).uniform(0.0021, 0.03, 500)
    angle = np.linspace(0, 2 * np.pi, 500)
    assert np.all(shape_at(modes, 0, x[np.hypot(x, y) > 0.0021], y[np.hypot(x, y) > 0.0021]) > 0)
    assert np.all(shape_at(modes, 0, near * np.cos(angle), near * np.sin(angle)) > 0)


def test_shape_at_is_continuous_across_mirrors_and_takes_its_parity_there(device: Device) -> None:
    modes = solve(device(SQUARE), 4, "quarter")
    along = np.linspace(-0.4, 0.4, 41)
    for index, parity in enumerate(modes.parity):
        above, below = (shape_at(modes, index, along, np.full(41, side * 1e-9)) for side in (1, -1))
        np.testing.assert_allclose(above, below, atol=1e-7)
        up, down = (shape_at(modes, index, along, np.full(41, side * 0.2)) for side in (1, -1))
        np.testing.assert_allclose(down, parity[0] * up, atol=1e-12)
        left, right = (shape_at(modes, index, np.full(41, side * 0.2), along) for side in (1, -1))
        np.testing.assert_allclose(right, parity[1] * left, atol=1e-12)


def test_shape_at_broadcasts_x_against_y(device: Device) -> None:
    modes = solve(device(SQUARE), 1)
    axis = np.linspace(-0.6, 0.6, 7)
    grid = shape_at(modes, 0, axis[None, :], axis[:, None])
    assert grid.shape == (7, 7)
    np.testing.assert_allclose(grid, grid.T, atol=1e-6)
    with pytest.raises(IndexError):
        shape_at(modes, 1, axis, axis)


def test_points_that_are_nowhere_are_refused_and_no_points_give_no_values(device: Device) -> None:
    modes = solve(device(SQUARE), 1, resolution=0.5)
    assert shape_at(modes, 0, np.array([]), np.array([])).shape == (0,)
    with pytest.raises(ParameterError, match="x, y: expected finite numbers in m"):
        shape_at(modes, 0, np.array([0.0, np.nan]), np.array(0.0))


def test_coarse_counterparts_bound_the_error_of_the_fine_modes(device: Device) -> None:
    model = device(SQUARE)
    fine = solve(model, 10, "full")
    coarse = align(solve(model, 14, "full", degree=3), fine)
    modes = replace(fine, coarse=coarse)
    exact = np.sqrt([1, 2.5, 2.5, 4, 5, 5, 6.5, 6.5, 8.5, 8.5])
    assert np.all(np.abs(modes.ratio - exact) < modes.ratio_error + 1e-12)
    assert np.all(modes.ratio_error < 3e-4)
    assert coarse.label == fine.label
    assert np.all(np.isinf(fine.ratio_error[1:]))
    assert fine.ratio_error[0] == 0


def test_a_mode_whose_pair_was_not_asked_for_finds_its_own_counterpart(device: Device) -> None:
    model = device('kind = "rectangle"\nwidth = "1.003 m"\nheight = "1 m"')
    fine = solve(model, 2, degree=4)
    coarse = solve(model, 6, degree=2)
    aligned = align(coarse, fine)
    assert aligned.label == fine.label == ("(1,1)", "(2,1)")
    np.testing.assert_allclose(aligned.frequency, coarse.frequency[:2], rtol=1e-12)


def test_counterparts_are_found_where_the_lower_degree_orders_modes_differently(
    device: Device,
) -> None:
    model = device('kind = "rectangle"\nwidth = "1.003 m"\nheight = "1 m"')
    fine = solve(model, 3, degree=4)
    coarse = solve(model, 4, degree=2)
    order = [0, 2, 1, 3]
    shuffled = replace(
        coarse,
        frequency=coarse.frequency[order],
        effective_mass=coarse.effective_mass[order],
        shapes=coarse.shapes[order],
        parity=tuple(coarse.parity[k] for k in order),
    )
    aligned = align(shuffled, fine)
    assert aligned.parity == fine.parity
    np.testing.assert_allclose(aligned.frequency, coarse.frequency[:3], rtol=1e-12)


def test_impossible_numbers_of_modes_are_refused_in_one_line(device: Device) -> None:
    domain = mesh(device(SQUARE), resolution=0.1)
    prestress = solve_prestress(domain, 2)
    with pytest.raises(ParameterError, match="count = 0: expected at least one mode"):
        solve_modes(prestress, 0, 2)
    with pytest.raises(ConvergenceError, match="ask for fewer modes or raise the resolution"):
        solve_modes(prestress, 500, 2)


def test_degrees_without_elements_or_curvature_are_refused_in_one_line(device: Device) -> None:
    model = device(SQUARE)
    domain = mesh(model, resolution=0.3)
    with pytest.raises(ParameterError, match="degree = 7: expected 1 to 6"):
        solve_prestress(domain, 7)
    bending = replace(domain, model=replace(model, bending=True))
    with pytest.raises(ParameterError, match="degree = 1: bending needs 2 or more"):
        solve_modes(solve_prestress(bending, 1), 1, 1)


SHARP = [(250, -5), (250, 5), (50, 5), (50, 50), (5, 50)]


def test_a_trampoline_with_sharp_corners_flaps_them_before_its_middle_moves(
    device: Device,
) -> None:
    # A square pad whose corners stand between the tethers, and carry next to no stress
    points = [
        (round(x * c - y * s), round(x * s + y * c))
        for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))
        for x, y in SHARP
    ]
    written = ", ".join(f'["{x} um", "{y} um"]' for x, y in points)
    free = [edge for edge in range(1, 21) if edge % 5 != 1]
    model = device(f'kind = "polygon"\npoints = [{written}]\nfree = {free}', model="bending = true")
    modes = solve(replace(model, film=load("trampoline").film), 5)
    corner = np.array([49.0e-6, 49.0e-6])
    middle = np.zeros(2)
    for index in range(4):
        (at_corner,), (at_middle,) = (
            shape_at(modes, index, where[:1], where[1:]) for where in (corner, middle)
        )
        assert abs(at_corner) > 0.9
        assert abs(at_middle) < 0.1
    along = np.linspace(0, 249e-6, 20)
    tether = np.abs(shape_at(modes, 4, along, 0 * along))
    assert tether[0] > 0.25
    assert np.all(np.diff(tether[along > 60e-6]) < 0)
