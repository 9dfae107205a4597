"""A film stress that varies is in equilibrium, against closed forms and polynomials."""

from functools import cache

import numpy as np
import pytest
from numpy.polynomial.legendre import Legendre, leggauss
from numpy.typing import NDArray
from scipy.special import jn_zeros, jv, jvp

from femnl.core.operators import Projection
from femnl.device.geometry import parse
from femnl.effects import library
from femnl.mechanics.modes.projection import project
from femnl.mechanics.prestress import solve_units
from femnl.observe.film import UNITS, SimulatedFilm
from femnl.observe.free_forms import TENSION
from femnl.pipeline import solve_modes
from tests.physics.changed_films import relative_shift, system_of

Array = NDArray[np.float64]
POISSON = 0.23
FILM = f"""
name = "ideal film"
[outline]
{{outline}}
[film]
thickness = "50 nm"
young = "250 GPa"
poisson = {POISSON}
density = "3100 kg/m^3"
stress = "1 GPa"
[model]
bending = false
edge = "clamped"
"""
SQUARE = FILM.format(outline='kind = "square"\nside = "100 um"')
CIRCLE = FILM.format(outline='kind = "circle"\ndiameter = "100 um"')
BOWL = 0.02


@cache
def film(text: str, count: int) -> SimulatedFilm:
    return SimulatedFilm(parse(text), count)


def polynomials(terms: int) -> tuple[Array, Array, Array, Array]:
    """Points and weights of Gauss, and (1 − x²) P_k with its slope, on [−1, 1]."""
    x, w = leggauss(64)
    rows = [Legendre.basis(k) * Legendre([2 / 3, 0, -2 / 3]) for k in range(terms)]
    return x, w, np.array([p(x) for p in rows]), np.array([p.deriv()(x) for p in rows])


@cache
def relaxed_bowl(terms: int) -> tuple[Array, Array, Array]:
    """The stress (xx, yy, xy) that a bowl x² + y² leaves in a clamped square [−1, 1]².

    By Ritz with polynomials that vanish at the edge; Young's modulus is 1 and does not count.
    """
    x, w, value, slope = polynomials(terms)
    mass, stiff = (value * w) @ value.T, (slope * w) @ slope.T
    mixed = (slope * w) @ value.T
    modulus, shear = 1 / (1 - POISSON**2), (1 - POISSON) / 2
    own = modulus * (np.kron(stiff, mass) + shear * np.kron(mass, stiff))
    other = modulus * (np.kron(mass, stiff) + shear * np.kron(stiff, mass))
    cross = modulus * (POISSON * np.kron(mixed, mixed.T) + shear * np.kron(mixed.T, mixed))
    bowl = x[:, None] ** 2 + x**2
    pull = bowl * np.outer(w, w)
    load = np.concatenate([(slope @ pull @ value.T).ravel(), (value @ pull @ slope.T).ravel()])
    u, v = np.linalg.solve(np.block([[own, cross], [cross.T, other]]), -load).reshape(
        2, terms, terms
    )
    xx, yy = slope.T @ u @ value, value.T @ v @ slope
    return (
        bowl + modulus * (xx + POISSON * yy),
        bowl + modulus * (yy + POISSON * xx),
        modulus * shear * (value.T @ u @ slope + slope.T @ v @ value),
    )


def work_on_sine(m: int, n: int, terms: int) -> float:
    """∫ S : ∇w ∇w over ∫ |∇w|², of the sine (m,n) under that stress."""
    xx, yy, xy = relaxed_bowl(terms)
    x, w, *_ = polynomials(terms)
    phase = np.pi / 2 * np.outer([m, n], x + 1)
    (sm, sn), (cm, cn) = np.sin(phase), np.cos(phase) * np.array([[m], [n]])
    dx, dy = np.outer(cm, sn), np.outer(sm, cn)
    area = np.outer(w, w)
    return float(
        np.sum(area * (xx * dx**2 + yy * dy**2 + 2 * xy * dx * dy)) / np.sum(area * (dx**2 + dy**2))
    )


def test_a_bowl_of_two_percent_moves_the_second_mode_up_as_relaxed_polynomials_say() -> None:
    simulated = film(SQUARE, 12)
    for m, n in ((2, 1), (2, 2), (3, 2)):
        exact, crude = (
            BOWL / 2 * (work_on_sine(m, n, terms) - work_on_sine(1, 1, terms)) for terms in (16, 10)
        )
        assert exact == pytest.approx(crude, abs=2e-8)
        slopes = simulated.projection.slopes[[3, 5], :2].sum(axis=(0, 1))
        even = simulated.projection.slopes[0, :2].sum(axis=0)
        part = np.diag(slopes) / np.diag(even)
        own = BOWL / 2 * (part[simulated.modes.label.index(f"({m},{n})")] - part[0])
        assert own == pytest.approx(exact, abs=2e-8)
    # The figure for (2,1); with the stress as it was before it relaxes, −912 ppm
    assert BOWL / 2 * (work_on_sine(2, 1, 16) - work_on_sine(1, 1, 16)) == pytest.approx(
        250.56e-6, abs=1e-8
    )


def test_the_effect_and_the_free_form_of_tension_both_relax() -> None:
    simulated = film(SQUARE, 12)
    plain = system_of(simulated)
    bowl = library()["tension_gradient"].changes["operators"](
        plain, {"slope_x": 0.0, "slope_y": 0.0, "bowl": BOWL}
    )
    none = dict.fromkeys((spec.name for spec in TENSION.parameters), 0.0)
    form = TENSION.changes["operators"](plain, none | {"x²": BOWL, "y²": BOWL})
    assert form.stiffness == pytest.approx(bowl.stiffness, abs=1e-12 * bowl.stiffness.max())
    shift = relative_shift(bowl, plain)
    assert shift[1] - shift[0] == pytest.approx(250.56e-6, abs=8e-6)  # first order, 2 % of it


@pytest.mark.parametrize(("order", "rank"), [(0, 0), (1, 1), (2, 3)])
def test_a_bowl_on_a_disc_is_the_closed_form(order: int, rank: int) -> None:
    # u = A (r³ − R²r) of u″ + u′/r − u/r² = −2bσ(1 − ν²) r/ER², clamped at R, gives
    # σ_r/σ − 1 = b/4 (1 + ν + (1 − ν) r²/R²), σ_θ/σ − 1 = b/4 (1 + ν + 3 (1 − ν) r²/R²).
    zero = jn_zeros(order, 1)[0]
    x, w = leggauss(40)
    r, w = (x + 1) / 2, w * (x + 1) / 4
    radial = (zero * jvp(order, zero * r)) ** 2
    around = (order * jv(order, zero * r) / r) ** 2
    across = (1 + POISSON + (1 - POISSON) * r**2) / 4
    along = (1 + POISSON + 3 * (1 - POISSON) * r**2) / 4
    exact = np.sum(w * (across * radial + along * around)) / np.sum(w * (radial + around))
    slopes = film(CIRCLE, 12).projection.slopes
    found = slopes[[3, 5], :2].sum(axis=(0, 1))[rank, rank] / slopes[0, :2, rank, rank].sum()
    assert found == pytest.approx(exact, rel=3e-6)


@cache
def hexagon(symmetry: str) -> Projection:
    outline = 'kind = "regular-polygon"\nsides = 6\nlong_axis = "100 um"'
    modes = solve_modes(parse(FILM.format(outline=outline)), 8, symmetry, cache=False)
    return project(modes, solve_units(modes.domain, UNITS))


def test_a_slope_along_any_side_of_a_hexagon_does_the_same() -> None:
    # x and y are one irreducible pair of the hexagon: |⟨1|S_x|2⟩|² summed over the pair (2, 3)
    # is that of S_y.
    slopes = hexagon("quarter").slopes[[1, 2], :2].sum(axis=1)
    x, y = np.sum(slopes[:, 0, 1:3] ** 2, axis=1)
    assert x == pytest.approx(y, rel=1e-5)
    assert x > 0


def test_a_uniform_stress_relaxes_nothing_in_a_clamped_film_without_holes() -> None:
    simulated = film(SQUARE, 12)
    units = solve_units(simulated.modes.domain, UNITS)
    moved = np.abs(units.displacement).max(axis=(1, 2))
    assert moved[0] < 1e-12 * moved[1:].min()
