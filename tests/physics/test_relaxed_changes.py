"""What holes leave of a change of the film stress, and shapes continued over them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh

from femnl.core.errors import ParameterError
from femnl.core.modes import Modes
from femnl.core.operators import Projection
from femnl.core.outline import Holes
from femnl.device.geometry import parse
from femnl.device.mesh import mesh
from femnl.mechanics.modes import shape_at, shapes_at
from femnl.mechanics.modes.projection import project
from femnl.mechanics.prestress import solve_units
from femnl.pipeline import solve_modes
from tests.blind.lab import holes
from tests.blind.lab.film import device

Array = NDArray[np.float64]

FILM = """
name = "four holes"
[outline]
kind = "square"
side = "100 um"
[holes]
lattice = "square"
pitch = "40 um"
count = [2, 2]
radius = "8 um"
[film]
thickness = "50 nm"
young = "250 GPa"
poisson = 0.23
density = "3100 kg/m^3"
stress = "1 GPa"
[model]
bending = false
edge = "clamped"
"""


@cache
def solved(symmetry: str = "auto") -> tuple[Modes, Projection]:
    modes = solve_modes(parse(FILM), 12, symmetry, cache=False)
    return modes, project(modes, solve_units(modes.domain, modes.prestress.degree))


def split(found: Projection, mass: Array, stress: tuple[float, float, float]) -> Array:
    """Return frequencies, in units of c/2π, under a film stress (xx, yy, xy).

    The stress is in units of the even one.
    """
    xx, yy, xy = stress
    stiffness = xx * found.slopes[0, 0] + yy * found.slopes[0, 1] + 2 * xy * found.slopes[0, 2]
    return np.asarray(np.sqrt(eigh(stiffness, mass, eigvals_only=True)))


def test_an_even_stress_leaves_what_the_modes_were_solved_with() -> None:
    modes, found = solved()
    stress = modes.domain.model.film.stress
    assert stress * (found.slopes[0, 0] + found.slopes[0, 1]) == pytest.approx(
        np.diag(modes.stiffness), abs=1e-7 * modes.stiffness.max()
    )


def test_a_quarter_half_and_whole_film_relax_every_weight_alike() -> None:
    parts = [solved(symmetry)[1].slopes[:, :, :4, :4] for symmetry in ("quarter", "half", "full")]
    # Signs of shapes are a matter of the mesh
    squares = [np.sum(part**2, axis=(2, 3)) for part in parts]
    assert squares[0].min() > 1e-4 * squares[0].max()
    for other in squares[1:]:
        assert other == pytest.approx(squares[0], rel=2e-4)


@pytest.mark.parametrize("stress", [(1.01, 0.99, 0.0), (1.0, 1.0, 0.01)])
def test_a_quarter_and_the_whole_film_relax_alike(stress: tuple[float, float, float]) -> None:
    rows = []
    for symmetry in ("quarter", "full"):
        modes, found = solved(symmetry)
        mass = np.diag(modes.effective_mass)
        rows.append(split(found, mass, stress) / split(found, mass, (1.0, 1.0, 0.0)) - 1)
    assert np.abs(rows[0]).max() > 1e-3
    assert rows[0] == pytest.approx(rows[1], abs=3e-6)


@pytest.mark.slow
def test_quadrilaterals_split_the_modes_as_much_as_femnl_does() -> None:
    model = parse(device("perforated").text.replace("bending = true", "bending = false"))
    modes = solve_modes(model, 20)
    found = project(modes, solve_units(modes.domain, 3))
    other = holes.solve(32, 5)
    xx, yy, xy = other["loads"]
    mass = np.diag(modes.effective_mass)
    plain = np.sqrt(eigh(xx + yy, eigvals_only=True))[:8]
    for a, s in ((0.01, 0.0), (0.0, 0.01)):
        own = (
            split(found, mass, (1 + a / 2, 1 - a / 2, s))[:8]
            / split(found, mass, (1.0, 1.0, 0.0))[:8]
            - 1
        )
        theirs = (
            np.sqrt(eigh((1 + a / 2) * xx + (1 - a / 2) * yy + s * xy, eigvals_only=True))[:8]
            / plain
            - 1
        )
        assert own == pytest.approx(theirs, abs=5e-3 * np.abs(own).max())
    unrelaxed = project(modes)
    assert (
        np.abs(
            split(unrelaxed, mass, (1.005, 0.995, 0.0)) / split(unrelaxed, mass, (1.0, 1.0, 0.0))
            - 1
        ).max()
        > 1.02 * 1.92e-3
    )


@pytest.mark.parametrize("symmetry", ["eighth", "quarter", "full"])
def test_shear_couples_the_first_mode_of_an_even_square_to_the_fourth_alike_from_any_wedge(
    symmetry: str,
) -> None:
    modes = solve_modes(
        replace(parse(FILM), holes=Holes(np.empty((0, 2)), 0.0)), 4, symmetry, cache=False
    )
    place = [int(np.argmin(np.abs(modes.frequency / modes.frequency[0] - r))) for r in (1, 2)]
    # h ∫ ½(∂xξ₁₁∂yξ₂₂ + ∂yξ₁₁∂xξ₂₂) of cosines and sines is 16/9 h.
    coupled = abs(project(modes).slopes[0, 2][place[0], place[1]])
    assert coupled == pytest.approx(16 / 9 * modes.domain.model.film.thickness, rel=1e-6)


def test_a_wedge_between_oblique_mirrors_is_refused() -> None:
    with pytest.raises(
        ParameterError, match="a wedge of 45° holds even stresses alone; mesh a quarter or more"
    ):
        solve_units(mesh(parse(FILM), "eighth"), 2)


def test_shapes_go_on_smoothly_over_holes_and_are_exact_beside_them() -> None:
    modes, found = solved()
    radius = modes.domain.model.holes.radius
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    centres = modes.domain.model.holes.centres
    centre = centres[0]
    rim = found.at(
        centre[0] + 1.001 * radius * np.cos(turn), centre[1] + 1.001 * radius * np.sin(turn)
    )[0]
    middle = found.at(centre[0], centre[1])[0]
    assert rim.min() < middle < rim.max()
    x, y = np.random.default_rng(2).uniform(-48e-6, 48e-6, (2, 500))
    away = np.min(
        np.hypot(
            x[:, None] - modes.domain.model.holes.centres[:, 0],
            y[:, None] - modes.domain.model.holes.centres[:, 1],
        ),
        axis=1,
    )
    film = away > 1.3 * radius
    every = shapes_at(modes, x[film], y[film])
    assert found.at(x[film], y[film]) == pytest.approx(every, abs=2e-4)
    assert every[4] == pytest.approx(shape_at(modes, 4, x[film], y[film]), abs=1e-15)
