"""Films put together from condensed cells.

Against the same films without condensation, and against meshes of another kind.
"""

import re
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from femnl import load
from femnl.core.device import Clamp, Edge, Model
from femnl.core.errors import ConvergenceError, ParameterError
from femnl.io.results.netcdf import read_modes, write_modes
from femnl.mechanics import lattice, nonlinearity
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.solvers import lowest_eigenpairs
from femnl.mechanics.lattice import solve_condensed, tile
from femnl.mechanics.lattice.condensed import MISSED, Condensed
from femnl.mechanics.lattice.relaxed import Frame, Relaxed
from femnl.mechanics.lattice.skeleton import summed
from femnl.mechanics.lattice.tile import Flexure
from femnl.mechanics.modes import solve_modes as solve_on_mesh
from femnl.mechanics.modes.shapes import walk
from femnl.mechanics.prestress import solve_prestress
from femnl.pipeline import solve_modes, solve_nonlinearity
from tests.physics.small_films import film

Array = NDArray[np.float64]


def uncondensed(model: Model, degree: int, count: int) -> Array:
    """ω² of the tiles' elements put together with every inner unknown kept, of all parities."""
    frame = Frame(tile(model), degree)
    relaxed = Relaxed(frame)
    skeleton = frame.skeleton
    first = skeleton.n_deflections + skeleton.n_slopes
    numbers = []
    stiff = []
    heavy = []
    for k, sides in enumerate(frame.sides):
        flexure = Flexure(sides, model, relaxed.mean[k], degree)
        tiles = len(frame.tiling.kinds[k].shifts)
        number = np.empty((tiles, flexure.bend.shape[0]), dtype=np.int64)
        number[:, flexure.inner] = first + np.arange(tiles * len(flexure.inner)).reshape(tiles, -1)
        first += tiles * len(flexure.inner)
        number[:, sides.dofs] = skeleton.deflections[k]
        number[:, sides.space.size :] = skeleton.n_deflections + skeleton.slopes[k]
        numbers.append(number)
        stiff.append(
            np.array(
                [
                    (flexure.bend + flexure.tension(s)).toarray()
                    for s in relaxed.stress(k, slice(None))
                ]
            )
        )
        heavy.append(flexure.inertia.toarray()[None])
    stiffness = summed(stiff, numbers, first)
    mass = summed(heavy, numbers, first)
    values = []
    for parity in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        known = skeleton.free(parity)
        at = np.flatnonzero(np.concatenate([known, np.ones(first - len(known), dtype=bool)]))
        values.append(
            lowest_eigenpairs(csc_matrix(stiffness[at][:, at]), csc_matrix(mass[at][:, at]), count)[
                0
            ]
        )
    return np.sort(np.concatenate(values))[:count]


@pytest.mark.parametrize(
    ("model", "degree"),
    [
        (film(4, 2), 4),
        pytest.param(film(3, 4), 3, marks=pytest.mark.slow),
        (film(5, 3, taper=20e-9), 3),
        (film(4, 2, radius=1.8e-6), 2),
        (film(1, 5, margin=3e-6), 3),
    ],
    ids=["even", "odd by even", "odd, tapered", "large holes", "one row"],
)
def test_condensed_cells_have_the_frequencies_of_the_film_that_keeps_every_unknown(
    model: Model, degree: int
) -> None:
    found = (2 * np.pi * solve_condensed(tile(model), 6, degree).frequency) ** 2
    np.testing.assert_allclose(found, uncondensed(model, degree, 6), rtol=1e-9)


@pytest.mark.parametrize("missed", [1e-8, 1e-10])
@pytest.mark.parametrize(
    "model", [film(4, 4, bending=False), film(3, 5, bending=False, taper=20e-9)]
)
def test_without_bending_condensed_cells_give_the_modes_of_the_mesh_that_they_make(
    model: Model, missed: float
) -> None:
    tiling = tile(model)
    found = solve_condensed(tiling, 5, 3, missed)
    known = solve_on_mesh(solve_prestress(tiling.domain, 3), 5, 3)
    np.testing.assert_allclose(found.frequency, known.frequency, rtol=1e-10)
    # What a basis misses of ω² is the square of what it misses of a shape. The typical tile's
    # stiffness mends that, and the stress of tiles is its own within 1.3 %: a hundredth is left.
    # The effective mass goes as the inverse square of the shape's largest value.
    left = 0.01 * np.sqrt(missed)
    np.testing.assert_allclose(found.effective_mass, known.effective_mass, rtol=2 * left)
    sign = np.sign(np.sum(found.shapes * known.shapes, axis=1))
    np.testing.assert_allclose(found.shapes * sign[:, None], known.shapes, atol=left)
    assert (found.label, found.parity) == (known.label, known.parity)


@pytest.mark.parametrize("model", [film(4, 3), film(2, 5, taper=20e-9)])
def test_the_stress_of_condensed_cells_is_that_of_the_mesh_that_they_make(model: Model) -> None:
    tiling = tile(model)
    found = Relaxed(Frame(tiling, 3)).prestress()
    known = solve_prestress(tiling.domain, 3)
    assert (
        np.abs(found.displacement - known.displacement).max()
        < 1e-10 * np.abs(known.displacement).max()
    )


def test_what_the_basis_of_cells_misses_is_told_and_taken_in() -> None:
    model = film(3, 3)
    known = uncondensed(model, 3, 14)
    source = Condensed(Relaxed(Frame(tile(model), 3)), MISSED)
    plain, _ = source.lowest((-1, -1), 4)
    missed = source.missed
    source.extend()
    better, _ = source.lowest((-1, -1), 4)
    assert missed > 1e-6
    assert source.missed < 1e-3 * missed
    assert plain[-1] / better[-1] - 1 == pytest.approx(0, abs=0.1 * missed)  # mended to first order
    np.testing.assert_allclose(
        (2 * np.pi * solve_condensed(tile(model), 14, 3).frequency) ** 2, known, rtol=1e-9
    )


def test_tops_that_touch_a_mirror_where_the_shape_vanishes_are_found() -> None:
    # Coarse triangles hold the antinode and reach the mirror, along which value, slope and bend are
    # nil.
    modes = solve_condensed(
        tile(
            film(3, 3, margin=3.6048537918959624e-06, radius=1.7840642417636783e-06, bending=False),
            0.8,
        ),
        9,
        3,
    )
    assert np.all(np.isfinite(modes.effective_mass))


def test_modes_too_short_for_the_cells_are_refused_with_what_is_left() -> None:
    # The four parities of 100 modes ask 112 corrections of each tile. Four extensions take 40.
    with pytest.raises(
        ConvergenceError,
        match=r"condensed cells leave \d\.\de-\d\d of ω² in the highest mode; ask for fewer modes",
    ) as refusal:
        solve_condensed(tile(film(2, 2)), 100, 3)
    (left,) = re.findall(r"leave (\S+) of", str(refusal.value))
    assert MISSED < float(left) < 1e-3


@pytest.mark.parametrize("edge", ["clamped", "sliding", "paper"])
@pytest.mark.parametrize("model", [film(4, 4), film(3, 2, taper=20e-9)])
def test_condensed_stretching_is_that_of_the_mesh_that_cells_make(model: Model, edge: Edge) -> None:
    modes = solve_condensed(tile(model), 4, 3)
    pairs = list(combinations_with_replacement(range(4), 2))
    known = nonlinearity.strain_energies(modes, pairs, edge)
    found = lattice.strain_energies(modes, pairs, edge)
    assert np.abs(found - known).max() < 1e-8 * np.abs(known).max()
    np.testing.assert_allclose(np.diagonal(found), np.diagonal(known), rtol=2e-7)


@pytest.mark.parametrize(
    "model",
    [film(5, 5), pytest.param(film(3, 4, bending=False), marks=pytest.mark.slow)],
    ids=["with bending", "a membrane"],
)
def test_tiled_and_meshed_films_differ_by_less_than_their_errors(model: Model) -> None:
    tiled = solve_modes(model, 5, cache=False)
    meshed = solve_modes(model, 5, symmetry="quarter", cache=False)
    assert tiled.domain.tiles == 1.0
    assert meshed.domain.tiles == 0.0
    np.testing.assert_array_less(
        np.abs(tiled.frequency - meshed.frequency), tiled.frequency_error + meshed.frequency_error
    )
    np.testing.assert_array_less(
        np.abs(tiled.ratio - meshed.ratio)[1:], (tiled.ratio_error + meshed.ratio_error)[1:]
    )
    assert np.all(tiled.frequency_error < 1e-4 * tiled.frequency)
    both = [solve_nonlinearity(m, cache=False) for m in (tiled, meshed)]
    np.testing.assert_array_less(
        np.abs(both[0].alpha - both[1].alpha), both[0].alpha_error + both[1].alpha_error
    )


@pytest.mark.parametrize("counts", [(2, 2), (3, 2), (1, 4), (3, 5)])
def test_tiles_cover_a_quarter_of_the_film_once(counts: tuple[int, int]) -> None:
    model = film(*counts)
    domain = tile(model).domain
    space = Space(domain.mesh, 4)
    area = sum(float(np.sum(dx)) for _, _, dx, _ in walk(space, np.zeros((1, space.size)), 8))
    width, height = model.outline.size or (0.0, 0.0)
    assert 4 * area == pytest.approx(
        width * height - np.prod(counts) * np.pi * model.holes.radius**2, rel=1e-7
    )
    ends = domain.mesh.p[:, domain.mesh.facets]
    lengths = {
        name: float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=0)[f].sum())
        for name, f in (domain.mesh.boundaries or {}).items()
    }
    assert lengths["clamped"] == pytest.approx((width + height) / 2, rel=1e-12)
    cut = model.holes.radius * (np.array(counts)[::-1] % 2 * counts)  # by holes on the mirror lines
    assert lengths["mirror-0"] == pytest.approx(width / 2 - cut[0], rel=1e-9)
    assert lengths["mirror-1"] == pytest.approx(height / 2 - cut[1], rel=1e-9)


def test_degenerate_pairs_of_a_tiled_square_are_degenerate() -> None:
    modes = solve_condensed(tile(film(4, 4)), 3, 4)
    assert modes.label == ("(1,1)", "(2,1)", "(1,2)")
    assert modes.frequency[1] == pytest.approx(modes.frequency[2], rel=1e-10)


def test_tiled_modes_read_back_have_the_same_nonlinearity(tmp_path: Path) -> None:
    model = film(3, 3)
    modes = solve_condensed(tile(model, 0.9), 2, 3)
    write_modes(tmp_path / "modes.nc", modes)
    again = read_modes(tmp_path / "modes.nc", model)
    assert again.domain.tiles == 0.9
    np.testing.assert_array_equal(
        solve_nonlinearity(again, cache=False).k3, solve_nonlinearity(modes, cache=False).k3
    )


def test_modes_on_another_mesh_than_their_tiles_make_are_refused() -> None:
    modes = solve_condensed(tile(film(3, 3)), 1, 2)
    domain = replace(modes.domain, tiles=1.7)
    moved = replace(modes, prestress=replace(modes.prestress, domain=domain))
    with pytest.raises(ConvergenceError, match="mesh of another mesher"):
        lattice.strain_energies(moved, [(0, 0)], "clamped")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: replace(m, clamp=Clamp(rotation=0.0)), "rigid edge"),
        (lambda m: replace(m, film=replace(m.film, gradient=(1e-4, 0.0))), "without gradient"),
        (
            lambda m: replace(m, outline=load("hexagon-278um").outline),
            "needs a square or rectangle",
        ),
        (
            lambda m: replace(m, holes=replace(m.holes, centres=m.holes.centres[1:])),
            "rectangular array",
        ),
        (
            lambda m: replace(m, holes=replace(m.holes, centres=m.holes.centres + 1e-7)),
            "array in the centre",
        ),
    ],
)
def test_films_that_have_no_tiles_say_why(change: Callable[[Model], Model], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        tile(change(film(3, 3)))


@pytest.mark.parametrize("margin", [-1e-6, 0.0, 30e-6])
def test_a_margin_that_makes_no_tile_is_told(margin: float) -> None:
    assert "needs a margin" in lattice.obstacle(film(4, 4, margin=margin))


def test_an_array_that_ends_at_the_edge_and_more_modes_than_cells_are_solved_on_one_mesh() -> None:
    flush = film(4, 4, margin=0.0)
    assert "needs a margin" in lattice.obstacle(flush)
    few, many = (solve_modes(film(3, 3), count, cache=False) for count in (4, 12))
    assert few.domain.tiles
    assert not many.domain.tiles
    assert np.all(
        np.abs(few.frequency - many.frequency[:4]) < few.frequency_error + many.frequency_error[:4]
    )
