"""StaticDeflection films against methods that know no elements, and against limits.

Sine series, integration in time, and Newton's method on the whole energy.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement, product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from scipy.optimize import minimize_scalar

from femnl.core.device import Model
from femnl.core.errors import ConvergenceError, ParameterError
from femnl.core.modes import Modes
from femnl.mechanics.static_deflection import Film, StaticDeflection, solve_static_deflection
from femnl.pipeline import solve_modes, solve_nonlinearity

Array = NDArray[np.float64]
Device = Callable[..., Model]

# m, N/m, kg/m², N/m
SIDE = 1e-4
TENSION = 200.0
MASS = 6e-4
YOUNG = 5e4
POISSON = 0.3
FILM = (
    'thickness = "200 nm"\nyoung = "250 GPa"\npoisson = 0.3\ndensity = "3000 kg/m^3"\nstress '
    '= "1 GPa"'
)
BOW = 1.0e-6


@pytest.fixture(scope="module")
def square(device: Device) -> Modes:
    return solve_modes(
        replace(device('kind = "square"\nside = "100 um"', film=FILM), edge="sliding"),
        4,
        cache=False,
    )


@dataclass(frozen=True)
class Sines:
    """Odd sines of a square membrane with sliding edges.

    k, m, and the tensor of ¼ Σ T q⁴, exact for the sines that are kept.

    Second-order strains are sums of cos·cos (xx, yy) and sin·sin (2xy), which u = (sin·cos,
    cos·sin) relaxes wave by wave.
    """

    k: Array
    m: Array
    energies: Array  # G_ijkl

    @property
    def tensor(self) -> Array:
        g = self.energies
        return np.asarray(2 / 3 * (g + g.transpose(0, 2, 1, 3) + g.transpose(0, 3, 2, 1)))

    @classmethod
    def build(cls, highest: int) -> "Sines":
        orders = list(product(range(1, highest + 1, 2), repeat=2))
        n = len(orders)
        points = 4 * highest
        angle = (np.arange(points) + 0.5) * np.pi / points
        cosine, sine = (
            np.array([f(a * angle) for a in range(2 * highest + 1)]) for f in (np.cos, np.sin)
        )
        # Coefficients
        size = (
            (SIDE / points) ** 2
            * np.outer(*(np.where(np.arange(2 * highest + 1) > 0, 2.0, 1.0),) * 2)
            / SIDE**2
        )
        pairs = list(combinations_with_replacement(range(n), 2))
        waves = np.pi / SIDE * np.arange(2 * highest + 1)
        a, b = np.meshgrid(waves, waves, indexing="ij")
        slopes = [
            (waves[p] * np.outer(cosine[p], sine[q]), waves[q] * np.outer(sine[p], cosine[q]))
            for p, q in orders
        ]
        strains = np.empty((len(pairs), *a.shape, 3))
        for row, (i, j) in zip(strains, pairs, strict=True):
            (ix, iy) = slopes[i]
            (jx, jy) = slopes[j]
            for c, (field, basis) in enumerate(
                ((ix * jx / 2, cosine), (iy * jy / 2, cosine), ((ix * jy + iy * jx) / 2, sine))
            ):
                row[..., c] = basis @ field @ basis.T * size
        plane = (
            YOUNG
            / (1 - POISSON**2)
            * np.array([[1, POISSON, 0], [POISSON, 1, 0], [0, 0, (1 - POISSON) / 2]])
        )
        zero = np.zeros_like(a)
        # ε of (U, V), (…, 3, 2)
        moves = np.stack(
            [np.stack([a, zero], -1), np.stack([zero, b], -1), np.stack([-b, -a], -1)], -2
        )
        stiff = moves.swapaxes(-1, -2) @ plane @ moves
        loads = np.einsum("abcd,ce,pabe->pabd", moves, plane, strains)
        relaxed = strains - np.einsum(
            "abcd,abde,pabe->pabc", moves, np.linalg.pinv(stiff, rcond=1e-10), loads
        )
        area = SIDE**2 / size / points**2
        energies = np.einsum("pabc,cd,qabd,ab->pq", strains, plane, relaxed, area, optimize=True)
        index = np.array(
            [[pairs.index((min(i, j), max(i, j))) for j in range(n)] for i in range(n)]
        )
        number = np.array([p * p + q * q for p, q in orders])
        return cls(
            TENSION * np.pi**2 / 4 * number,
            np.full(n, MASS * SIDE**2 / 4),
            energies[index[:, :, None, None], index[None, None]],
        )

    def bowed(self, depth: float, stressed: bool) -> "Rest":
        bow = np.zeros(len(self.k))
        bow[0] = depth
        own = 4 * np.einsum("ikjl,k,l->ij", self.energies, bow, bow)
        own += 2 * np.einsum("ijkl,k,l->ij", self.energies, bow, bow) * stressed
        stiffness = np.diag(self.k) + own
        return Rest(
            stiffness, np.diag(self.m), 3 * np.einsum("ijkl,l->ijk", self.tensor, bow), self.tensor
        )


@dataclass(frozen=True)
class Rest:
    """Forces −(K q + K₂ q q + T q q q) about a rest state."""

    stiffness: Array
    mass: Array
    quadratic: Array
    cubic: Array

    def mode(self, index: int) -> tuple[float, Array]:
        """ω and the shape, its value at the centre 1."""
        square, vectors = eigh(self.stiffness, self.mass)
        centre = self.centre @ vectors[:, index]
        return float(np.sqrt(square[index])), vectors[:, index] / centre

    @property
    def centre(self) -> Array:
        """Values of the sines at the centre."""
        n = int(np.sqrt(len(self.stiffness)))
        sign = (-1.0) ** np.arange(n)
        return np.outer(sign, sign).ravel()

    def time_alpha(self, size: float) -> float:
        """Return α of the first mode from free motion of 30 periods at two amplitudes."""
        omega, shape = self.mode(0)
        load = np.einsum("ijk,j,k->i", self.quadratic, shape, shape)
        shifts = []
        for q in (size, 2 * size):
            start = q * shape - q**2 / 2 * (
                np.linalg.solve(self.stiffness, load)
                + np.linalg.solve(self.stiffness - 4 * omega**2 * self.mass, load)
            )

            def flow(_: float, state: Array) -> Array:
                x, speed = np.split(state, 2)
                force = self.stiffness @ x + self.quadratic @ x @ x + self.cubic @ x @ x @ x
                return np.concatenate([speed, -force / np.diag(self.mass) / omega**2])

            time = np.linspace(0, 60 * np.pi, 3001)
            start = np.concatenate([start, 0 * start])
            motion = (
                self.centre
                @ solve_ivp(
                    flow, (0, time[-1]), start, "DOP853", time, rtol=1e-11, atol=1e-11 * q
                ).y[: len(shape)]
            )
            window = np.hanning(len(time)) ** 2

            def leakage(
                w: float, motion: Array = motion, window: Array = window, time: Array = time
            ) -> float:
                return -float(
                    abs(np.sum(window * motion * np.exp(-1j * w * time))) / np.abs(motion).max()
                )

            found = minimize_scalar(
                leakage, bounds=(0.98, 1.02), method="bounded", options={"xatol": 1e-13}
            )
            shifts.append((found.x - 1) * 8 / 3 / q**2)
        return float((4 * shifts[0] - shifts[1]) / 3)


@pytest.fixture(scope="module")
def sines() -> Sines:
    return Sines.build(7)


def test_the_sines_are_those_of_the_flat_square(sines: Sines) -> None:
    # k₃/m of sliding edges in closed form.
    wave = np.pi / SIDE
    exact = YOUNG / (1 - POISSON**2) * SIDE**2 / 4 * wave**4 * ((3 - POISSON**2) / 8 + POISSON / 4)
    assert sines.tensor[0, 0, 0, 0] == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("stressed", [True, False])
def test_a_deep_bow_has_the_frequency_and_coefficients_of_sine_series(
    stressed: bool, square: Modes, sines: Sines
) -> None:
    found = solve_static_deflection(square, depth=BOW, stressed=stressed)
    rest = sines.bowed(BOW, stressed)
    omega, shape = rest.mode(0)
    load = np.einsum("ijk,j,k->i", rest.quadratic, shape, shape)
    k = float(shape @ rest.stiffness @ shape)
    k2 = float(load @ shape)
    k3 = float(np.einsum("ijkl,i,j,k,l", rest.cubic, *(shape,) * 4))
    still, moved = (
        load @ np.linalg.solve(rest.stiffness - s * rest.mass, load) for s in (0.0, 4 * omega**2)
    )
    exact = {
        "frequency": omega / 2 / np.pi,
        "stiffness": k,
        "k2": k2,
        "k3": k3,
        "alpha": (k3 - 4 / 3 * still - 2 / 3 * moved) / k,
    }
    for name, value in exact.items():
        assert getattr(found, name)[0] == pytest.approx(value, rel=2e-6), name
    assert found.depth == pytest.approx(BOW, rel=1e-6)
    for name in ("frequency", "k2", "k3", "alpha"):
        error = getattr(found, f"{name}_error")[0]
        assert abs(getattr(found, name)[0] - exact[name]) < error < 1e-4 * abs(exact[name]), name
    assert found.alpha[0] < 0.9 * k3 / k  # deep enough for the bow to show


def test_integration_in_time_finds_the_cubic_coefficient_of_the_bowed_film(square: Modes) -> None:
    found = solve_static_deflection(square, depth=BOW)
    rest = Sines.build(3).bowed(BOW, True)
    assert rest.time_alpha(4e-8) == pytest.approx(found.alpha[0], rel=1e-3)


def test_a_small_bow_gives_the_expansion_of_the_flat_films_tensor(square: Modes) -> None:
    flat = solve_nonlinearity(square, tensor=True, cache=False)
    assert flat.tensor is not None
    errors = []
    for depth in (4e-7, 2e-7):
        held = solve_static_deflection(square, depth=depth)
        free = solve_static_deflection(square, depth=depth, stressed=False)
        rise = (
            np.array([(r.frequency / square.frequency) ** 2 - 1 for r in (held, free)])
            * square.stiffness
            / depth**2
        )
        own = np.array([[3.0], [2.0]]) * flat.k3[0]
        errors.append(
            [*np.abs(rise[:, 0] / own[:, 0] - 1), abs(held.k2[0] / (3 * flat.k3[0] * depth) - 1)]
        )
        expected = 3 * np.array([flat.tensor[k, k, 0, 0] for k in range(4)])
        np.testing.assert_allclose(rise[0], expected, rtol=2e3 * depth)
        mixed = held.alpha[0] - (
            held.k3[0] / held.stiffness[0] - 10 / 9 * (held.k2[0] / held.stiffness[0]) ** 2
        )
        assert abs(mixed) < 0.2 * abs(held.alpha[0] - flat.alpha[0])  # other modes than its own
        assert held.k2[1] == held.k2[3] == 0  # odd modes have no quadratic force
    np.testing.assert_allclose(errors[1], np.array(errors[0]) / 4, rtol=0.1)


UNEVEN = (
    'thickness = "500 nm"\nyoung = "250 GPa"\npoisson = 0.27\ndensity = "3100 '
    'kg/m^3"\nstress = '
    '"0.2 GPa"'
)


@pytest.fixture(scope="module")
def uneven(device: Device) -> Modes:
    """A perforated hexagon with bending and a stress far from even."""
    holes = 'lattice = "square"\npitch = "4 um"\ncount = [3, 3]\nradius = "1 um"'
    model = device(
        'kind = "regular-polygon"\nsides = 6\nlong_axis = "20 um"', holes, UNEVEN, "bending = true"
    )
    return solve_modes(model, 2, resolution=0.5, cache=False)


def test_newtons_method_on_the_whole_energy_finds_the_curve_of_a_film_under_pressure(
    uneven: Modes,
) -> None:
    pressure = 1e7
    found = solve_static_deflection(uneven, pressure=pressure)
    film = Film(uneven, "clamped")
    even = (1, 1)
    load = pressure * film.area
    shape = found.shapes[0]
    rest = film.deflect(load, even)
    size = film.space.size
    pull = film.mass @ shape / (shape @ film.mass @ shape)
    curve = []
    for step in (-0.02, -0.01, 0.01, 0.02):
        force = step * found.stiffness[0] * np.sqrt(found.stiffness[0] / found.k3[0])
        state = film.deflect(load + force / film.domain.copies * pull, even, rest)
        q = pull @ (state - rest)[2 * size :]
        curve.append((q, force / q))
    places, ratios = np.transpose(curve)
    fit = np.polynomial.Polynomial.fit(places, ratios, 3).convert().coef
    assert fit[0] == pytest.approx(found.stiffness[0], rel=1e-7)
    assert fit[1] == pytest.approx(found.k2[0], rel=1e-5)
    assert found.k2[0] * abs(found.depth) > 0.1 * found.stiffness[0]  # a bow that counts


def test_a_bow_of_nothing_leaves_the_flat_film(square: Modes) -> None:
    flat = solve_nonlinearity(square, cache=False)
    for found in (
        solve_static_deflection(square, depth=0.0),
        solve_static_deflection(square, pressure=0.0),
    ):
        assert found.depth == 0
        np.testing.assert_allclose(found.frequency, square.frequency, rtol=1e-9)
        np.testing.assert_allclose(found.alpha, flat.alpha, rtol=1e-8)
        assert np.all(np.abs(found.k2) < 1e-9 * flat.k3 * 1e-6)


def test_a_bow_of_nothing_has_infinite_bars_where_one_degree_was_solved(square: Modes) -> None:
    # The rise is then zero to the last digit or nearly so, as rounding has it; neither times
    # infinity may become no number.
    found = solve_static_deflection(replace(square, coarse=None), depth=0.0)
    assert np.all(np.isinf(found.frequency_error))


def test_a_low_pressure_bends_the_square_as_prandtls_membrane(square: Modes) -> None:
    # w(0) = 0.0736713 pL²/T, Timoshenko & Goodier, Theory of Elasticity, section 109.
    assert solve_static_deflection(square, pressure=1.0).depth == pytest.approx(
        0.0736713 * SIDE**2 / TENSION, rel=2e-6
    )
    assert solve_static_deflection(square, pressure=-1.0).depth == pytest.approx(
        -0.0736713 * SIDE**2 / TENSION, rel=2e-6
    )


def test_a_bow_of_an_odd_shape_pushes_odd_modes(device: Device) -> None:
    model = replace(device('kind = "square"\nside = "100 um"', film=FILM), edge="sliding")
    results: list[StaticDeflection] = []
    for symmetry in ("quarter", "full"):
        modes = solve_modes(model, 3, symmetry, cache=False)
        results.append(solve_static_deflection(modes, depth=3e-7, shape=1))
    quarter, full = results
    np.testing.assert_allclose(quarter.frequency, full.frequency, rtol=1e-6)
    np.testing.assert_allclose(quarter.alpha, full.alpha, rtol=1e-4)
    np.testing.assert_allclose(np.abs(quarter.k2[1]), np.abs(full.k2[1]), rtol=1e-4)
    assert quarter.k2[0] == 0
    assert abs(full.k2[0]) < 1e-6 * abs(full.k2[1])


@pytest.mark.parametrize(
    ("bow", "message"),
    [
        ({}, "either its depth in m or a pressure"),
        ({"depth": 1e-7, "pressure": 1.0}, "either its depth in m or a pressure"),
        ({"depth": float("nan")}, "expected a finite number, found nan"),
        ({"pressure": 1.0, "stressed": False}, "goes with a depth"),
        ({"depth": 1e-4}, "is not shallow; expected at most 0.1 of that"),
        ({"depth": 1e-7, "shape": 4}, "shape = 4: expected 0 to 3"),
    ],
)
def test_bows_that_mean_nothing_are_refused(
    bow: dict[str, Any], message: str, square: Modes
) -> None:
    with pytest.raises(ParameterError, match=message):
        solve_static_deflection(square, **bow)


def test_a_load_that_newtons_method_cannot_follow_is_told(square: Modes) -> None:
    film = Film(square, "clamped")
    even = tuple(abs(p) for p in square.parity[0])
    with pytest.raises(ConvergenceError, match="lower the load"):
        film.deflect(1e30 * film.area, even)
