"""In-plane inertia against a closed form, integration in time, and the limit of a stiff film."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from scipy.optimize import minimize_scalar
from scipy.sparse import csc_matrix

from femnl.core.device import Edge, Model
from femnl.core.errors import ConvergenceError
from femnl.core.modes import Modes
from femnl.mechanics.fem.solvers import factorize
from femnl.mechanics.nonlinearity import film_membrane, respond, solve_inertia, solve_nonlinearity
from femnl.mechanics.nonlinearity.stretching import in_plane_mass, stretching
from femnl.pipeline import solve_modes

Array = NDArray[np.float64]
Device = Callable[..., Model]
STIFF = (1e-3, 1e-4, 1e-5)


def film(stretch: float) -> str:
    """A film with σ/E = `stretch`."""
    return (
        f'thickness = "1 um"\nyoung = "{0.1 / stretch:.15g} GPa"\npoisson = 0.3\ndensity = '
        '"1000 kg/m^3"\nstress = '
        '"0.1 GPa"'
    )


def rectangle(device: Device, stretch: float, edge: Edge = "sliding") -> Modes:
    model = device('kind = "rectangle"\nwidth = "130 um"\nheight = "100 um"', film=film(stretch))
    return solve_modes(replace(model, edge=edge), 4, cache=False)


def closed_form(modes: Modes) -> Array:
    """Relative change of k₃ on sliding edges.

    div C m of sin px sin qy pushes along three waves: (2p, 0), (0, 2q), and (2p, 2q), all of them
    longitudinal.
    """
    device = modes.domain.model.film
    omega = 2 * np.pi * modes.frequency
    width, height = modes.domain.model.outline.size or (0.0, 0.0)
    nu = device.poisson
    mass = device.density * device.thickness
    plane = device.young * device.thickness / (1 - nu**2)
    change = []
    for label, w in zip(modes.label, omega, strict=True):
        m, n = (int(order) for order in str(label).strip("()").split(","))
        p = np.pi * m / width
        q = np.pi * n / height
        waves = [
            (p**2 * (nu * q**2 - p**2) ** 2 / 2, p**2),
            (q**2 * (nu * p**2 - q**2) ** 2 / 2, q**2),
            ((p**2 + q**2) ** 3 / 4, p**2 + q**2),
        ]
        still, moved = (
            sum(plane**2 / 16 * load / (4 * plane * k - mass * s) for load, k in waves)
            for s in (0.0, 4 * w**2)
        )
        # G over the area, k₃ = 2G
        relaxed = plane * ((p**4 + q**4) * (3 - nu**2) / 128 + nu * p**2 * q**2 / 32) / 1.0
        change.append(-(moved - still) / (3 * relaxed))
    return np.array(change)


@pytest.mark.parametrize("stretch", [0.004, 0.2])
def test_the_change_on_sliding_edges_is_that_of_three_longitudinal_waves(
    stretch: float, device: Device
) -> None:
    modes = rectangle(device, stretch)
    found = solve_inertia(modes, "sliding")
    exact = closed_form(modes)
    np.testing.assert_allclose(found.change, exact, rtol=2e-6)
    assert np.all(np.abs(found.change - exact) < found.change_error)
    assert np.all(found.change_error < 1e-3 * np.abs(exact))
    assert np.all(found.change < 0)


def test_the_change_falls_as_the_square_of_the_speeds_ratio(device: Device) -> None:
    changes = [
        solve_inertia(rectangle(device, stretch), "clamped", cross=True).cross for stretch in STIFF
    ]
    coarse, middle, fine = (np.asarray(c) / s for c, s in zip(changes, STIFF, strict=True))
    np.testing.assert_allclose(middle - fine, (coarse - fine) / 11, rtol=0.02)
    np.testing.assert_allclose(middle, fine, rtol=2e-3)


class Coupled:
    """Two modes and the film in its plane under their load, as ordinary differential equations."""

    def __init__(self, modes: Modes, edge: Edge) -> None:
        pairs = [(0, 0), (0, 1), (1, 1)]
        whole = stretching(modes, pairs, film_membrane(modes, edge))
        mass = in_plane_mass(modes, whole.space)
        copies = modes.domain.copies
        stiff = np.zeros((0, 0))
        heavy = np.zeros((0, 0))
        loads = np.zeros((0, 3))
        energies = np.zeros((3, 3))
        for members, supports in whole.sectors(modes.domain.wedge, edge):
            k = csc_matrix(supports.T @ whole.stiffness @ supports)
            m = supports.T @ mass @ supports
            f = supports.T @ whole.loads[:, members]
            energies[np.ix_(members, members)] = whole.energies[np.ix_(members, members)]
            solve = factorize(k)
            basis = np.zeros((k.shape[0], 0))
            step = f
            for _ in range(2):  # moments of the response to each load
                step = solve(m @ step if basis.size else step)
                basis = np.linalg.qr(np.hstack([basis, step / np.linalg.norm(step, axis=0)]))[0]
            zero = np.zeros((basis.shape[1], 3))
            zero[:, members] = basis.T @ f
            loads = np.vstack([loads, zero])
            stiff = np.block(
                [
                    [stiff, np.zeros((len(stiff), len(zero)))],
                    [np.zeros((len(zero), len(stiff))), basis.T @ k @ basis],
                ]
            )
            heavy = np.block(
                [
                    [heavy, np.zeros((len(heavy), len(zero)))],
                    [np.zeros((len(zero), len(heavy))), basis.T @ m @ basis],
                ]
            )
        self.square, turn = eigh(stiff, heavy)
        self.energies = copies * energies
        self.loads = np.sqrt(copies) * turn.T @ loads
        self.k = modes.stiffness[:2]
        self.m = modes.effective_mass[:2]
        self.omega = 2 * np.pi * modes.frequency[:2]

    def forces(self, q: Array, u: Array) -> tuple[Array, Array]:
        """Accelerations of the modes and of the film in its plane."""
        pairs = np.array([q[0] ** 2, 2 * q[0] * q[1], q[1] ** 2])
        # ∂W/∂(pairs), W = ½ u·Ku − pairs·f·u + ½ pairs·A·pairs
        pull = self.energies @ pairs - self.loads.T @ u
        own = np.array(
            [2 * q[0] * pull[0] + 2 * q[1] * pull[1], 2 * q[0] * pull[1] + 2 * q[1] * pull[2]]
        )
        return -(self.k * q + own) / self.m, self.loads @ pairs - self.square * u

    def frequency(self, amplitude: tuple[float, float], mode: int) -> float:
        """Return the angular frequency [rad/s] of a mode from 30 of its periods."""
        size = len(self.square)
        start = np.zeros(size)
        for k, pair in ((0, 0), (1, 2)):
            start += (
                amplitude[k] ** 2
                / 2
                * self.loads[:, pair]
                * (1 / self.square + 1 / (self.square - 4 * self.omega[k] ** 2))
            )
        for w in (self.omega[0] - self.omega[1], self.omega[0] + self.omega[1]):
            start += amplitude[0] * amplitude[1] * self.loads[:, 1] / (self.square - w**2)
        unit = self.omega[mode]

        def flow(_: float, state: Array) -> Array:
            q, speed, u, flowing = np.split(state, [2, 4, 4 + size])
            own, plane = self.forces(q, u)
            return np.concatenate([speed, own / unit**2, flowing, plane / unit**2])

        state = np.concatenate([amplitude, np.zeros(2), start, np.zeros(size)])
        time = np.linspace(0, 60 * np.pi, 3001)
        motion = solve_ivp(
            flow, (0, time[-1]), state, "DOP853", time, rtol=1e-10, atol=1e-10 * max(amplitude)
        ).y[mode]
        window = np.hanning(len(time)) ** 2

        def leakage(w: float) -> float:
            return -float(
                abs(np.sum(window * motion * np.exp(-1j * w * time))) / np.abs(motion).max()
            )

        found = minimize_scalar(
            leakage, bounds=(0.99, 1.02), method="bounded", options={"xatol": 1e-12}
        )
        return float(found.x * unit)


def test_integration_in_time_finds_the_changed_coefficients(device: Device) -> None:
    edge: Edge = "clamped"
    modes = rectangle(device, 0.05, edge)
    film = Coupled(modes, edge)
    still = solve_nonlinearity(modes, edge, tensor=True)
    moved = solve_inertia(modes, edge, cross=True)
    assert still.tensor is not None
    assert moved.cross is not None
    for mode, partner, weight in ((0, 0, 3 / 8), (0, 1, 3 / 4), (1, 0, 3 / 4)):
        static = still.tensor[mode, mode, partner, partner] / modes.stiffness[mode]
        shifts = []
        for size in (2e-3, 4e-3):
            amplitude = np.full(2, 1e-5)
            amplitude[partner] = 1.0
            amplitude *= np.sqrt(size / static)
            shifts.append(
                (film.frequency((amplitude[0], amplitude[1]), mode) / film.omega[mode] - 1)
                / (weight * size)
            )
        limit = 2 * shifts[0] - shifts[1]
        assert limit - 1 == pytest.approx(moved.cross[mode, partner], rel=1e-2)


def test_a_sum_of_modes_on_an_in_plane_resonance_is_told() -> None:
    matrix = csc_matrix(np.diag([1.0, 2.0]))
    mass = csc_matrix(np.eye(2))
    with pytest.raises(ConvergenceError, match="meets a resonance"):
        respond(matrix, mass, factorize(matrix), 2.0, np.ones(2))
    np.testing.assert_allclose(
        respond(matrix, mass, factorize(matrix), 1.5, np.ones(2)), [-2, 2], rtol=1e-10
    )


def test_without_counterparts_no_error_is_claimed(device: Device) -> None:
    modes = replace(rectangle(device, 0.01), coarse=None)
    assert np.all(np.isinf(solve_inertia(modes, "clamped").change_error))
