"""The even film that replaces a lattice of holes.

Constants of one cell, limits, and modes against those of the full film.
"""

from dataclasses import replace

import numpy as np
import pytest

from femnl import load
from femnl.core import resources
from femnl.core.device import Model
from femnl.core.errors import ParameterError
from femnl.core.outline import Holes, Outline
from femnl.device.geometry.placing import moved
from femnl.mechanics.lattice import solve_cell, solve_homogenised
from femnl.pipeline import solve_modes, solve_nonlinearity
from femnl.validation import load as load_case

PITCH = 8.56e-6


@pytest.fixture(scope="module")
def square() -> Model:
    model: Model = load("square-270um-perforated")
    return model


def with_array(model: Model, n: int, radius: float = 0.9e-6) -> Model:
    """An n × n array of holes in the centre of the film."""
    places = PITCH * (np.arange(n) - (n - 1) / 2)
    return replace(
        model, holes=Holes(np.stack(np.meshgrid(places, places), -1).reshape(-1, 2), radius)
    )


@pytest.mark.parametrize("radius", [0.75, 0.9, 1.4])
def test_the_cells_tension_and_mass_are_those_of_the_unit_cell(
    square: Model, radius: float
) -> None:
    known = {r.quantity: r.value for r in load_case(resources.cases() / "unit_cell.py").references}
    cell = solve_cell(with_array(square, 2, radius * 1e-6), PITCH)
    film = square.film
    assert cell.tension / (film.stress * film.thickness) == pytest.approx(
        known[f"⟨σ⟩/σ₀, r = {radius} µm"], abs=3e-5
    )
    assert cell.mass / (film.density * film.thickness) == pytest.approx(
        1 - np.pi * (radius * 1e-6 / PITCH) ** 2, rel=1e-7
    )


def test_a_cell_with_a_small_hole_has_the_constants_of_a_dilute_film(square: Model) -> None:
    # One hole in plane stress costs, of the mean strain at rest, 3φ in 1/E and φ/3·(…) as in
    # Kachanov, Appl. Mech. Rev. 45, 304 (1992).
    radius = 0.2e-6
    cell = solve_cell(with_array(square, 2, radius), PITCH)
    film = square.film
    share = np.pi * (radius / PITCH) ** 2
    young = film.young * film.thickness / (1 + 3 * share)
    poisson = (film.poisson + share) / (1 + 3 * share)
    assert cell.c11 + cell.c12 == pytest.approx(young / (1 - poisson), rel=10 * share**2)
    assert cell.c66 * 2 * (1 + poisson) == pytest.approx(young, rel=10 * share**2)
    assert cell.tension == pytest.approx(
        film.stress * film.thickness * (1 - 2 * share / (1 - film.poisson)), rel=10 * share**2
    )


def test_bending_of_a_cell_with_a_small_hole_is_that_of_the_film(square: Model) -> None:
    cell = solve_cell(with_array(square, 2, 0.1e-6), PITCH)
    film = square.film
    rigidity = film.young * film.thickness**3 / 12 / (1 - film.poisson**2)
    assert cell.d_axis == pytest.approx(rigidity, rel=5e-3)
    assert cell.d_mixed == pytest.approx(rigidity, rel=5e-3)


def test_holes_without_bending_slow_short_waves(square: Model) -> None:
    cell = solve_cell(with_array(replace(square, bending=False), 2), PITCH)
    assert -1e-2 * cell.tension * PITCH**2 < cell.d_axis < 0
    assert -1e-2 * cell.tension * PITCH**2 < cell.d_mixed < 0


def test_the_even_film_has_the_modes_of_the_full_one(square: Model) -> None:
    small = replace(
        load("square-270um-perforated"),
        outline=scaled(square, 8 / 30),
        holes=with_array(square, 8).holes,
    )
    even, duffing = solve_homogenised(small, 4)
    full = solve_modes(small, 4, cache=False)
    assert even.label == full.label
    np.testing.assert_allclose(even.frequency, full.frequency, rtol=2e-4)
    np.testing.assert_allclose(even.ratio, full.ratio, rtol=3e-4)
    np.testing.assert_allclose(even.effective_mass, full.effective_mass, rtol=3e-3)
    np.testing.assert_allclose(
        duffing.alpha, solve_nonlinearity(full, cache=False).alpha, rtol=3e-3
    )


@pytest.mark.slow
def test_the_even_film_is_within_2e_5_of_the_full_one_in_ratios_for_900_holes(
    square: Model,
) -> None:
    even, duffing = solve_homogenised(square, 10)
    full = solve_modes(square, 10, cache=False)
    np.testing.assert_allclose(even.frequency, full.frequency, rtol=2e-5)
    np.testing.assert_allclose(even.ratio, full.ratio, rtol=2e-5)
    np.testing.assert_allclose(
        duffing.alpha, solve_nonlinearity(full, cache=False).alpha, rtol=3e-4
    )


def scaled(model: Model, factor: float) -> Outline:
    """The outline of the film, scaled."""
    outline = model.outline
    segments = tuple(
        replace(
            s,
            start=(s.start[0] * factor, s.start[1] * factor),
            end=(s.end[0] * factor, s.end[1] * factor),
        )
        for s in outline.segments
    )
    size = None if outline.size is None else (outline.size[0] * factor, outline.size[1] * factor)
    return replace(outline, segments=segments, size=size, length=outline.length * factor)


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (load("hexagon-278um-perforated"), "needs a square or rectangle"),
        (load("square-270um"), "needs a rectangular array of at least two"),
        (
            replace(
                load("square-270um"),
                holes=Holes(np.array([[0, 0], [0, 1e-5], [1e-5, 0], [1e-5, 1e-5]]), 1e-6),
            ),
            "array in the centre",
        ),
        (moved(load("square-270um-perforated"), (1e-3, 0.0)), "lies about the origin.*move it"),
    ],
)
def test_films_without_a_rectangular_array_are_refused(model: Model, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        solve_homogenised(model, 1)


def test_a_free_edge_is_refused(square: Model) -> None:
    free = tuple(replace(s, clamped=k > 0) for k, s in enumerate(square.outline.segments))
    with pytest.raises(
        ParameterError,
        match="held at all its edges, and one of this film's ends free; solve the full film",
    ):
        solve_homogenised(replace(square, outline=replace(square.outline, segments=free)), 1)


def test_overlapping_holes_are_refused(square: Model) -> None:
    with pytest.raises(ParameterError, match="expected more than the diameter"):
        solve_cell(square, 1.7e-6)
