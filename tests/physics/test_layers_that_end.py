"""Films at rest whose layers end within them, against collocation of a drum in two parts."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_bvp

from femnl.core.device import Model
from femnl.core.errors import ParameterError
from femnl.core.modes import Modes
from femnl.mechanics.static_deflection import solve_static_deflection
from femnl.mechanics.static_deflection.film import Film
from femnl.pipeline import solve_modes
from tests.physics.test_layers_at_rest import (
    DISC,
    HEIGHT,
    HINGED,
    MASS,
    NU,
    RADIUS,
    RIGIDITY,
    SIZE,
    SQUARE,
    YOUNG,
    laminate,
)

Array = NDArray[np.float64]
PART = 0.6
"""Radius of the metal over that of the drum."""
SMALL = 1e-3
"""The unit of turns and of displacements over the radius; also the radius where regions begin."""
METAL = f'shape = {{kind = "circle", diameter = "{100 * PART} um"}}\n'
AROUND = (
    'shape = {kind = "combined", parts = [{shape = {kind = "circle", diameter = "100 um"}}, '
    f'{{operation = "subtract", shape = {{kind = "circle", diameter = "{100 * PART} um"}}}}]}}\n'
)
STRIP = 'shape = {kind = "rectangle", width = "60 um", height = "20 um"}\n'


@dataclass(frozen=True)
class Part:
    """An even part of a drum, about the middle of its film.

    A [N/m], B [N], D [N m], tension N₀ [N/m] and moment M₀ [N] of its stresses, mass [kg/m²].
    """

    membrane: float
    couple: float
    bending: float
    tension: float
    moment: float
    mass: float

    @property
    def rigidity(self) -> float:
        """D − B²/A [N m]."""
        return self.bending - self.couple**2 / self.membrane


def part(stress: Array, plies: int, mass: float) -> Part:
    size = SIZE[:plies]
    height = HEIGHT[:plies]
    moduli = YOUNG[:plies] / (1 - NU**2)
    pull = stress[:plies] * size
    return Part(
        float(moduli @ size),
        float(moduli @ (size * height)),
        float(moduli @ (size**3 / 12 + size * height**2)),
        float(pull.sum()),
        float(pull @ height),
        mass,
    )


class Drum:
    """Kirchhoff's plate of two even parts with all of von Kármán's stretching, by collocation.

    In each part, with lengths in R: φ = w′, L f = f″ + f′/r − f/r²,
    (D − B²/A) Lφ = R² (Nφ + Q), Lu + φφ′ + (1 − ν)φ²/2r = (B/A) Lφ, and (rQ)′ = r ω²μR² w.
    u, φ, w, Q, the tension N and the moment are continuous.
    """

    def __init__(self, stress: Array, around: bool) -> None:
        bare, metal = part(stress, 1, 3000 * SIZE[0]), part(stress, 2, MASS)
        self.parts = (bare, metal) if around else (metal, bare)
        s = np.linspace(0, 1, 400)
        found = solve_bvp(
            self._rest_slopes, self._rest_ends, s, np.zeros((10, s.size)), tol=1e-8, max_nodes=10**5
        )
        assert found.success
        self._rest = found.sol
        deflection = SMALL * RADIUS * np.concatenate([found.y[4], found.y[9]])
        self.depth = float(deflection[np.argmax(np.abs(deflection))])

    def frequency(self, near: float) -> float:
        """Return the frequency [Hz] of the fundamental mode about rest, near to one."""
        self._square = (2 * np.pi * near) ** 2
        s = np.linspace(0, 1, 400)
        r = self._radii(s)
        start = np.zeros((12, s.size))
        for k, x in enumerate(r):
            start[6 * k + 2] = -np.pi / 2 * np.sin(np.pi * x)
            start[6 * k + 4] = np.cos(np.pi * x / 2) ** 2
        found = solve_bvp(
            self._mode_slopes, self._mode_ends, s, start, p=[1.0], tol=1e-7, max_nodes=10**5
        )
        assert found.success
        assert found.p is not None
        return near * float(np.sqrt(found.p[0]))

    @staticmethod
    def _radii(s: Array) -> tuple[Array, Array]:
        return SMALL + (PART - SMALL) * s, PART + (1 - PART) * s

    @staticmethod
    def _resultants(y: Array, r: Array | float, of: Part) -> tuple[Array, Array]:
        """N − N₀ and the moment + M₀ of y = u, u′, φ, φ′ in full units."""
        u, du, turn, bend = y[:4]
        strain = du + turn**2 / 2 + NU * u / r
        curvature = (bend + NU * turn / r) / RADIUS
        return (
            of.membrane * strain - of.couple * curvature,
            of.bending * curvature - of.couple * strain,
        )

    def _rest_slopes(self, s: Array, y: Array) -> Array:
        found = []
        for r, width, own, of in zip(
            self._radii(s), (PART - SMALL, 1 - PART), np.split(y, 2), self.parts, strict=True
        ):
            u, du, turn, bend, _ = own
            pull = of.tension + self._resultants(SMALL * own, r, of)[0]
            laplace = pull * turn * RADIUS**2 / of.rigidity
            second = of.couple / of.membrane / RADIUS * laplace - du / r + u / r**2
            second -= SMALL * (turn * bend + (1 - NU) / 2 * turn**2 / r)
            found.append(
                width * np.array([du, second, bend, laplace - bend / r + turn / r**2, turn])
            )
        return np.concatenate(found)

    def _rest_ends(self, a: Array, b: Array) -> Array:
        inner, outer = self.parts
        pulls = [
            (of.tension + n, m - of.moment)
            for of, (n, m) in (
                (inner, self._resultants(SMALL * b[:5], PART, inner)),
                (outer, self._resultants(SMALL * a[5:], PART, outer)),
            )
        ]
        return np.array(
            [
                a[0] - SMALL * a[1],
                a[2] - SMALL * a[3],
                *b[[5, 7, 9]],
                *(b[[0, 2, 4]] - a[[5, 7, 9]]),
                (pulls[0][0] - pulls[1][0]) / (SMALL * outer.membrane),
                (pulls[0][1] - pulls[1][1]) / (SMALL * outer.bending / RADIUS),
            ]
        )

    def _about_rest(self, y: Array, rest: Array, r: Array | float, of: Part) -> tuple[Array, Array]:
        """What a motion y changes of N and of the moment."""
        u, du, turn, bend = y[:4]
        strain = du + rest[2] * turn + NU * u / r
        curvature = (bend + NU * turn / r) / RADIUS
        return (
            of.membrane * strain - of.couple * curvature,
            of.bending * curvature - of.couple * strain,
        )

    def _mode_slopes(self, s: Array, y: Array, p: Array) -> Array:
        found = []
        for r, width, own, rest, of in zip(
            self._radii(s),
            (PART - SMALL, 1 - PART),
            np.split(y, 2),
            np.split(SMALL * self._rest(s), 2),
            self.parts,
            strict=True,
        ):
            u, du, turn, bend, w, shear = own
            pull = of.tension + self._resultants(rest, r, of)[0]
            more = self._about_rest(own, rest, r, of)[0]
            laplace = (pull * turn + more * rest[2] + shear) * RADIUS**2 / of.rigidity
            second = of.couple / of.membrane / RADIUS * laplace - du / r + u / r**2
            second -= turn * rest[3] + rest[2] * bend + (1 - NU) * rest[2] * turn / r
            load = p[0] * self._square * of.mass * RADIUS**2 * w
            rows = [du, second, bend, laplace - bend / r + turn / r**2, turn, load - shear / r]
            found.append(width * np.array(rows))
        return np.concatenate(found)

    def _mode_ends(self, a: Array, b: Array, p: Array) -> Array:
        inner, outer = self.parts
        n, m = self._about_rest(b[:6], SMALL * self._rest(1.0)[:5], PART, inner)
        n_out, m_out = self._about_rest(a[6:], SMALL * self._rest(0.0)[5:], PART, outer)
        load = p[0] * self._square * inner.mass * RADIUS**2 * a[4]
        return np.array(
            [
                a[0] - SMALL * a[1],
                a[2] - SMALL * a[3],
                *b[[6, 8, 10]],
                *(b[[0, 2, 4]] - a[[6, 8, 10]]),
                (n - n_out) / outer.membrane,
                (m - m_out) / (outer.bending / RADIUS),
                (a[5] - load * SMALL / 2) / inner.tension,
                (b[5] - a[11]) / inner.tension,
                a[4] - 1,
            ]
        )


def stresses(stretched: float, metal: float) -> Array:
    """Stresses of film and metal [Pa]: a tension of `stretched`² D/R² in the film."""
    return np.array([stretched**2 * RIGIDITY / RADIUS**2 / SIZE[0], metal])


def drum(stretched: float, metal: float) -> Model:
    """A clamped drum with metal in its middle."""
    return laminate(DISC, stresses(stretched, metal), metal=METAL)


@pytest.mark.parametrize(
    ("stretched", "metal", "around"),
    [(3, 1e3, False), (3, 5e6, False), (3, -5e6, False), (20, 5e6, False), (3, 5e6, True)],
)
def test_a_drum_with_metal_on_a_part_rests_and_rings_as_collocation_says(
    stretched: float, metal: float, around: bool
) -> None:
    """Bent by up to the thickness of the film; the collocation is right to some 3e-6."""
    stress = stresses(stretched, metal)
    model = laminate(DISC, stress, metal=AROUND if around else METAL)
    exact = Drum(stress, around)
    modes = solve_modes(model, 1, cache=False)
    found = solve_static_deflection(modes)
    assert found.depth == pytest.approx(exact.depth, rel=5e-6, abs=0)
    frequency = float(found.frequency[0])
    assert frequency == pytest.approx(exact.frequency(frequency), rel=3e-6, abs=0)
    assert abs(frequency - exact.frequency(frequency)) < found.frequency_error[0]


def derivatives(modes: Modes, film: Film, state: Array) -> tuple[Array, Array]:
    parity = (1,) * len(modes.parity[0])
    force, tangent = film.stretching(state)
    more, coupled = film.coupling(state, parity)
    return force + more, (tangent + coupled).toarray()


def test_derivatives_of_the_energy_agree_with_each_other() -> None:
    modes = solve_modes(drum(3, 5e6), 1, cache=False, resolution=0.4)
    film = Film(modes, "clamped", eccentric=True)
    rng = np.random.default_rng(5)
    size = film.space.size
    columns = film.admissible((1, 1), (1, 1))
    state, x = (columns @ rng.normal(size=columns.shape[1]) for _ in range(2))
    state *= 1e-9
    step = 1e-12
    ahead, behind = (derivatives(modes, film, state + s * step * x) for s in (1, -1))
    _, tangent = derivatives(modes, film, state)
    np.testing.assert_allclose(tangent, tangent.T, atol=1e-12 * np.abs(tangent).max())
    change = (ahead[0] - behind[0]) / (2 * step)
    np.testing.assert_allclose(change, tangent @ x, atol=1e-6 * np.abs(change).max())
    motion = np.concatenate([np.zeros(2 * size), x[2 * size :]])
    ahead, behind = (derivatives(modes, film, state + s * step * motion) for s in (1, -1))
    third = (ahead[1] - behind[1]) @ motion / (2 * step)
    loads, _ = film.second_order(state, motion[None], ((1, 1),))
    np.testing.assert_allclose(2 * loads[:, 0], third, atol=1e-6 * np.abs(third).max())


def test_wedges_and_the_whole_film_bend_alike() -> None:
    """A square with a strip of metal across: modes of all parities about both mirrors."""
    stress = np.array([20 * RIGIDITY / RADIUS**2 / SIZE[0], -2e6])
    model = laminate(SQUARE, stress, metal=STRIP)
    found = [
        solve_static_deflection(solve_modes(model, 4, cache=False, symmetry=symmetry))
        for symmetry in ("full", "quarter")
    ]
    whole, wedge = found
    assert wedge.depth == pytest.approx(whole.depth, rel=5e-5, abs=0)
    np.testing.assert_allclose(wedge.frequency, whole.frequency, rtol=1e-5)
    assert wedge.k2[0] == pytest.approx(whole.k2[0], rel=1e-4, abs=0)
    assert str(wedge.k2[1]) == "0.0"
    np.testing.assert_allclose(wedge.alpha, whole.alpha, rtol=1e-4)


def test_a_drum_bends_alike_however_its_metal_is_turned() -> None:
    corners = np.array([[-30, -10], [30, -10], [30, 10], [-30, 10]])
    found = []
    for angle in (0.0, 0.7):
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        points = [[f"{x:.9f} um", f"{y:.9f} um"] for x, y in corners @ turn.T]
        shape = f'shape = {{kind = "polygon", points = {points}}}\n'.replace("'", '"')
        model = laminate(DISC, stresses(3, -5e6), metal=shape)
        modes = solve_modes(model, 1, cache=False, symmetry="full")
        found.append(solve_static_deflection(modes))
    straight, turned = found
    assert turned.depth == pytest.approx(straight.depth, rel=1e-4, abs=0)
    assert turned.frequency == pytest.approx(straight.frequency, rel=2e-5, abs=0)
    assert turned.k2 == pytest.approx(straight.k2, rel=1e-3, abs=0)


def test_a_pressure_goes_with_the_layers() -> None:
    model = drum(3, 1e2)
    modes = solve_modes(model, 1, cache=False, resolution=0.6)
    alone, pushed, both, none = (
        solve_static_deflection(each, pressure=p).depth
        for each, p in (
            (modes, None),
            (solve_modes(drum(3, 0.0), 1, cache=False, resolution=0.6), 1e-4),
            (modes, 1e-4),
            (modes, 0.0),
        )
    )
    assert none == alone
    assert both == pytest.approx(alone + pushed, rel=1e-4)


@pytest.mark.parametrize(
    ("more", "metal", "told"),
    [
        (HINGED, 'shape = {kind = "circle", diameter = "100 um"}\n', "reaches an edge that may"),
        ('gradient = ["0.1 nm/um", "0 nm/um"]\n', METAL, "leave taper and gradient out"),
    ],
)
def test_a_rest_that_is_not_modelled_is_refused(more: str, metal: str, told: str) -> None:
    modes = solve_modes(
        laminate(DISC, np.array([1e9, 1e8]), more=more, metal=metal), 1, cache=False
    )
    with pytest.raises(ParameterError, match=told):
        solve_static_deflection(modes)
