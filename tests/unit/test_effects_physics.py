"""The physics of single effects, against integration in time, closed forms and other meshes."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial.legendre import Legendre, leggauss
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import eigsh

from femnl.core.operators import Projection
from femnl.core.resonator import Resonator
from femnl.core.stages import (
    Fringe,
    Harmonics,
    ModalSystem,
    Motion,
    Oscillator,
    Signal,
)
from femnl.device.geometry import load
from femnl.effects import library
from femnl.observe.response.branches import duffing_branches
from femnl.optics.sampled import harmonics
from femnl.resonator import couple
from femnl.resonator.balance import Balance

Array = NDArray[np.float64]
FILM = load("square-270um").film
SIDE = 270e-6
TABLE = {
    "bending_stiffness",
    "stress_anisotropy",
    "aspect_ratio",
    "shear_stress",
    "added_mass",
    "gas_loading",
    "trapped_gas",
    "clamp_loss",
    "optical_spring",
    "electrostatic_softening",
    "compliant_clamp",
    "hole_dispersion",
    "layer_thickness",
    "frequency_drift",
    "frame_mode",
    "tension_gradient",
    "yielding_edge",
    "nonlinear_damping",
    "quintic_stiffness",
    "quadratic_stiffness",
    "internal_resonance",
    "crosstalk",
    "fano_background",
    "group_delay",
    "lock_in_filter",
    "one_sided_saturation",
    "unsettled_mode",
    "sloping_background",
    "drive_compression",
    "nonlinear_readout",
    "gas_damping",
    "photothermal",
    "thermal_stress",
    "mechanical_overtones",
    "multilayer_fringe",
    "finite_spot",
    "phase_tilt",
    "static_bow",
    "mode_admixture",
    "resonance_drift",
    "doublet",
    "detector_bandwidth",
    "trigger_jitter",
    "detector_saturation",
    "stage_scale",
    "stage_rotation",
    "beating_pair",
    "duffing_shift",
    "energy_exchange",
    "feed_through",
    "filter_exit",
    "working_point",
}
KINDS = {
    "beating_pair": {"decay"},
    "duffing_shift": {"decay"},
    "energy_exchange": {"decay"},
    "feed_through": {"decay"},
    "filter_exit": {"decay"},
    "working_point": {"decay"},
    "compliant_clamp": {"spectrum"},
    "gas_loading": {"spectrum", "series"},
    "trapped_gas": {"spectrum", "series"},
    "gas_damping": {"spectrum", "series"},
    "clamp_loss": {"spectrum"},
    "layer_thickness": {"spectrum"},
    "frame_mode": {"spectrum"},
    "optical_spring": {"series"},
    "electrostatic_softening": {"series"},
    "frequency_drift": {"spectrum", "response", "series", "decay"},
    "quadratic_stiffness": {"response", "map", "trace", "record"},
    "internal_resonance": {"response"},
    "nonlinear_damping": {"response", "record", "decay"},
    "crosstalk": {"response", "map", "trace"},
    "detector_saturation": {"response", "map", "trace"},
    "detector_bandwidth": {"map", "trace"},
    "trigger_jitter": {"map", "trace"},
    "multilayer_fringe": {"map", "trace"},
    "mechanical_overtones": {"map", "trace"},
    "finite_spot": {"map"},
    "nonlinear_readout": {"response"},
    "photothermal": {"series"},
    "group_delay": {"response"},
    "sloping_background": {"response"},
    "fano_background": {"response"},
    "lock_in_filter": {"response"},
    "one_sided_saturation": {"response", "map", "trace"},
    "unsettled_mode": {"response"},
}


def test_the_library_holds_every_cause_that_files_may_name_and_no_other() -> None:
    assert set(library()) == TABLE


@pytest.mark.parametrize("name", KINDS)
def test_an_effect_shows_in_the_kinds_of_data_that_physics_lets_it(name: str) -> None:
    assert set(library()[name].kinds) == KINDS[name]


def rectangle(box: tuple[float, float], n: int = 7) -> ModalSystem:
    """Ideal modes sin·sin of a rectangle with stiffness and mass in closed form."""
    orders = np.array([(p, q) for p in range(1, n + 1) for q in range(1, n + 1)])
    k2 = (np.pi * orders / np.array(box)) ** 2
    area = box[0] * box[1] / 4
    h = FILM.thickness
    slopes = np.zeros((6, 3, len(k2), len(k2)))
    slopes[0, 0], slopes[0, 1] = (h * area * np.diag(k2[:, a]) for a in (0, 1))
    grid = np.linspace(-1, 1, 9)
    projection = Projection(
        slopes, np.zeros((6, len(k2), len(k2))), max(box) / 2, grid, grid, np.zeros((len(k2), 9, 9))
    )
    mass = FILM.density * h * area * np.eye(len(k2))
    return ModalSystem(
        FILM.stress * (slopes[0, 0] + slopes[0, 1]), mass, FILM.stress, FILM, projection, box
    )


def string(length: float, depth: float, n: int = 2000) -> Array:
    """Squared wave numbers of a string whose ends follow w = ∓δ w', by finite elements."""
    h = length / n
    step = np.eye(2)[0] - np.eye(2)[1]
    place = np.stack([np.arange(n), np.arange(n) + 1])
    rows, columns = np.broadcast_arrays(place[:, None], place[None, :])

    def joined(element: Array, ends: float) -> csc_matrix:
        values = np.concatenate([np.repeat(element.ravel(), n), [ends, ends]])
        return csc_matrix(
            (values, (np.append(rows.ravel(), [0, n]), np.append(columns.ravel(), [0, n])))
        )

    k = joined(np.outer(step, step) / h, 1 / depth)
    m = joined((np.ones((2, 2)) + np.eye(2)) * h / 6, 0.0)
    return np.sort(eigsh(k, 7, m, sigma=0.0, return_eigenvectors=False))


def test_a_compliant_clamp_lowers_modes_as_a_string_between_springs() -> None:
    depth = 6e-6
    box = (270e-6, 200e-6)
    system = rectangle(box)
    loose = library()["compliant_clamp"].changes["operators"](system, {"depth_cubed": depth**3})
    exact = (
        np.add.outer(string(box[0], depth), string(box[1], depth)).ravel()
        * (1 + 2 * depth / np.sqrt(box[0] * box[1])) ** 2
    )
    found = np.diag(loose.stiffness) / np.diag(loose.mass) / system.speed**2
    np.testing.assert_allclose(found, exact, rtol=3e-5)
    shift = found / (np.diag(system.stiffness) / np.diag(system.mass) / system.speed**2) - 1
    assert np.ptp(shift) > 0.02


def test_a_compliant_clamp_of_a_square_lowers_low_modes_most() -> None:
    system = rectangle((SIDE, SIDE))
    loose = library()["compliant_clamp"].changes["operators"](system, {"depth_cubed": 1e-15})
    shift = np.diag(loose.stiffness) / np.diag(system.stiffness) - 1
    low = shift[0]
    high = shift[-1]
    assert 0 < low < high


def averaged(mode: Oscillator) -> NDArray[np.complex128]:
    """Return the amplitude on the low branch by iterating the stage's equation."""
    per = 2 / mode.linewidth
    f0 = mode.frequency[0]
    linear = mode.peak * mode.force[0]
    delta = per * (f0 - mode.driven)
    square = 8 * mode.linewidth / (3 * f0 * abs(mode.alpha))
    x = np.zeros_like(delta)
    for _ in range(200):
        pulled = per * mode.pull * linear**2 / square * (x * linear**2 / square) ** (mode.order - 2)
        a = per * 0.375 * f0 * mode.alpha * linear**2 + pulled
        x = duffing_branches(delta, a.real, a.imag, continued=True).x[0]
    return np.asarray(linear / (delta + a.real * x + 1j * (1 + a.imag * x)))


# f₀ = 1 Hz, w = 0.04/2π Hz
W0 = 2 * np.pi
GAMMA = 0.04


def oscillator(frequency: Array, force: float, alpha: float) -> Oscillator:
    """The same in the terms of the stage."""
    width = GAMMA / (2 * np.pi)
    peak = force / (W0 * GAMMA)
    silent = np.zeros(len(frequency), complex)
    return Oscillator(
        np.ones(1),
        width,
        alpha,
        0.0,
        0.0,
        np.ones(1),
        peak,
        np.zeros(1),
        frequency,
        float(frequency.mean()),
        silent,
    )


def test_quadratic_stiffness_lowers_alpha_by_ten_ninths_of_its_square() -> None:
    kappa = 1.0
    alpha = 1.6

    def rate(amplitude: float) -> float:
        """Return the frequency of free oscillation between turning points a and b."""

        def energy(u: Array | float) -> Array | float:
            return u**2 / 2 + kappa * u**3 / 3 + alpha * u**4 / 4

        low = brentq(
            lambda u: float(energy(u) - energy(amplitude)),
            -2 * amplitude,
            -0.5 * amplitude,
            xtol=1e-15,
        )
        middle = (amplitude + low) / 2
        half = (amplitude - low) / 2
        psi = np.pi * (np.arange(400) + 0.5) / 400
        u = middle + half * np.cos(psi)
        return float(1 / np.mean(half * np.sin(psi) / np.sqrt(2 * (energy(amplitude) - energy(u)))))

    plain = oscillator(np.ones(1), 0.01, alpha)
    bent = library()["quadratic_stiffness"].changes["oscillator"](plain, {"kappa2": kappa})
    first = [(rate(a) - 1) / (0.375 * a**2) for a in (0.02, 0.01)]
    # Linear in a to the next order: the first harmonic is not quite the largest displacement.
    assert 2 * first[1] - first[0] == pytest.approx(bent.alpha, abs=2e-3)


def test_quadratic_stiffness_moves_the_film_at_rest_and_at_twice_the_drive() -> None:
    kappa = 0.05
    start = [1.0, 0.0]
    rate = 1 - 5 / 12 * kappa**2
    t = np.linspace(0, 40 * 2 * np.pi / rate, 4001)[:-1]
    run = solve_ivp(
        lambda t, s: [s[1], -s[0] - kappa * s[0] ** 2],
        (0, t[-1]),
        start,
        "DOP853",
        rtol=1e-11,
        atol=1e-12,
        t_eval=t,
    )
    u = run.y[0]
    orders = np.array([np.mean(u * np.exp(-1j * n * rate * t)) * (2 if n else 1) for n in range(3)])
    one = np.ones((1, 1))
    motion = Motion(
        orders[1] * one,
        np.zeros(1),
        np.zeros(1),
        np.zeros(1),
        one,
        np.ones(1),
        0,
        orders[1] * np.ones(1),
        4 * np.pi,
    )
    moved = library()["quadratic_stiffness"].changes["motion"](motion, {"kappa2": kappa})
    assert moved.theta[0] == pytest.approx(orders[0].real, rel=0.02)
    assert abs(moved.displacement[1, 0] - orders[2]) < 0.03 * abs(orders[2])


@pytest.mark.parametrize("order", [2, 3])
def test_internal_resonance_is_the_wiggle_that_two_coupled_modes_show(order: int) -> None:
    alpha = 0.3
    coupling = {2: 8.0, 3: 150.0}[order]
    force = 0.02
    crossing = 1.004
    loss = 0.15
    frequency = np.array([0.99, 0.999, 1.002, 1.004, 1.006, 1.009, 1.015])
    second = 2 * np.pi * order * crossing
    tensors = (
        {"quadratic": {(0, 0, 1): coupling}} if order == 2 else {"cubic": {(0, 0, 0, 1): coupling}}
    )
    pair = couple(
        [Resonator(1.0, W0 / GAMMA, alpha), Resonator(order * crossing, second / loss)],
        [1.0, 1.0],
        **tensors,
    )
    plain = oscillator(frequency, force, alpha)
    square = 8 * plain.linewidth / (3 * alpha)
    # B = −c A^p / 2^{p−1} / D with D = 2ω₂·2πp (f_j/p − f + iw/2), and the force back c p A*^{p−1}
    # B / 2^{p−1}, over 2ω₀·2π.
    strength = (
        coupling**2
        * order
        / 4 ** (order - 1)
        * square ** (order - 1)
        / (2 * second * 2 * np.pi * order * 2 * W0 * 2 * np.pi)
    )
    values = {
        "coupling_square": strength,
        "offset": crossing - plain.middle,
        "width": loss / (2 * np.pi * order),
        "order": order,
    }
    found = averaged(library()["internal_resonance"].changes["oscillator"](plain, values))
    effect = np.abs(np.abs(averaged(plain)) / np.abs(found) - 1).max()
    assert effect > 0.04
    full = Balance.of(pair, np.array([force, 0.0]), 6)
    starts = [full.pack(np.array([[0, a], [0, 0]])) for a in found]
    measured = [
        full.unpack(full.solve(start, 2 * np.pi * f / full.rate))[0, 1]
        for start, f in zip(starts, frequency, strict=True)
    ]
    np.testing.assert_allclose(np.abs(found), np.abs(measured), rtol=0.15 * effect)


def test_saturation_of_a_sweep_is_the_first_harmonic_of_the_clipped_sinusoid() -> None:
    tau = np.linspace(0, 2 * np.pi, 40001)[:-1]
    volts = np.array([0.3, 0.7, 0.95, 1.0]) * np.exp(0.4j)
    signal = Signal(volts, np.ones(4), np.ones(4), 0.0, 1.0, np.zeros(4), np.ones(4))
    clipped = library()["detector_saturation"].changes["signal"](signal, {"clipped": 0.4})
    exact = [
        2 * np.mean(np.clip((v * np.exp(1j * tau)).real, -0.6, 0.6) * np.exp(-1j * tau))
        for v in volts
    ]
    np.testing.assert_allclose(clipped.voltage, exact, rtol=1e-6)


def test_saturation_of_a_fringe_clips_the_voltage() -> None:
    for name, floor in (("detector_saturation", -0.7), ("one_sided_saturation", -np.inf)):
        plain = Fringe(np.array([0, 1 + 0j]), 1.0, None)
        clipped = library()[name].changes["fringe"](plain, {"clipped": 0.3})
        assert (clipped.floor, clipped.limit) == (pytest.approx(floor), pytest.approx(0.7))


def test_a_detector_that_clips_nothing_leaves_the_fringe_of_a_stack_alone() -> None:
    # Its overtones make it exceed the size of its first coefficient, from which a fringe's contrast
    # is reckoned.
    fringe = Fringe(np.array([0, 1, 0.3 * np.exp(0.4j), 0.1j]), 632.8e-9, None)
    z = np.linspace(0, 3, 7)
    u = (z * 632.8e-9 / (4 * np.pi)).astype(complex)
    motion = Motion(
        u[None],
        np.full(7, 0.7),
        np.zeros(7),
        np.zeros(7),
        np.ones((1, 7)),
        np.ones(1),
        0,
        u,
        632.8e-9,
    )
    clip = library()["detector_saturation"].changes["fringe"]
    orders = np.arange(1, 5)
    plain = harmonics(motion, fringe, orders)
    np.testing.assert_allclose(
        harmonics(motion, clip(fringe, {"clipped": 0.0}), orders), plain, atol=1e-5
    )
    assert np.abs(harmonics(motion, clip(fringe, {"clipped": 0.1}), orders) - plain).max() > 0.01


def test_crosstalk_adds_the_drive_to_the_first_harmonic_only() -> None:
    plain = Harmonics(np.zeros((3, 4), complex), np.array([1, 2, 3]), 1e6, 0.5)
    found = library()["crosstalk"].changes["harmonics"](plain, {"real": 0.2, "imag": -0.4}).values
    np.testing.assert_allclose(found[0], 0.1 - 0.2j)
    assert not found[1:].any()


def test_tilt_and_bow_turn_the_fringe_more_at_the_shorter_wavelength() -> None:
    x = np.array([-1e-4, 2e-4])
    shapes = np.array([[0.5, 1.0]])
    for name, values, expected in (
        ("phase_tilt", {"slope_x": 1e-4, "slope_y": 0.0}, 1e-4 * x),
        ("static_bow", {"depth": 2e-8}, 2e-8 * shapes[0]),
    ):
        for wavelength in (532e-9, 632.8e-9):
            motion = Motion(
                np.ones((1, 2), complex),
                np.zeros(2),
                x,
                0 * x,
                shapes,
                np.ones(1),
                0,
                np.ones(2, complex),
                wavelength,
            )
            moved = library()[name].changes["motion"](motion, values)
            np.testing.assert_allclose(moved.theta, 4 * np.pi / wavelength * expected)


def test_overtones_follow_the_power_of_the_swing_and_its_phase() -> None:
    swing = np.array([1.0, 0.5]) * np.exp(0.3j)
    shapes = np.ones((2, 2))
    motion = Motion(
        swing[None],
        np.zeros(2),
        np.zeros(2),
        np.zeros(2),
        shapes,
        np.array([1.0, 2.0]),
        0,
        swing,
        1.0,
    )
    sung = library()["mechanical_overtones"].changes["motion"](
        motion, {"cos2": 1e-2, "sin2": 0.0, "cos3": 0.0, "sin3": 2e-2}
    )
    np.testing.assert_allclose(sung.displacement[1], 1e-2 * np.array([1, 0.25]) * np.exp(0.6j))
    np.testing.assert_allclose(sung.displacement[2], -2e-2j * np.array([1, 0.125]) * np.exp(0.9j))


def stiff_string(layer: float, depth: float, n: int = 130) -> Array:
    """Return (ω/c)² of a stiff string of length 1 with layer ℓ, by Legendre–Ritz.

    Springs 1/δ hold its ends, and nothing turns them.
    """
    bubble = Legendre([2 / 3, 0, -2 / 3])
    slopes = [Legendre([0.0]), *(bubble * Legendre.basis(j) for j in range(n))]
    shapes = [Legendre([1.0]), *(slope.integ() for slope in slopes[1:])]
    t, w = leggauss(2 * n)
    v = np.array([f(t) for f in shapes])
    s = 2 * np.array([f(t) for f in slopes])
    c = 4 * np.array([f.deriv()(t) for f in slopes])
    e = np.array([f(np.array([-1.0, 1.0])) for f in shapes])
    scale = 1 / np.sqrt((v**2) @ w + 1e-3 * (c**2) @ w)[:, None]
    v = v * scale
    s = s * scale
    c = c * scale
    e = e * scale
    return np.asarray(
        eigh(
            (s * w / 2) @ s.T + layer**2 * (c * w / 2) @ c.T + e @ e.T / depth,
            (v * w / 2) @ v.T,
            eigvals_only=True,
        )[:5]
    )


def held_string(squares: Array, layer: float) -> ModalSystem:
    """Return a string of length 1 with such (ω/c)² (5,) and layer ℓ as a film that is long."""
    slopes = np.zeros((6, 3, 5, 5))
    slopes[0, 0] = np.diag(squares)
    grid = np.linspace(-0.5, 0.5, 9)
    projection = Projection(slopes, np.zeros((6, 5, 5)), 0.5, grid, grid, np.zeros((5, 9, 9)))
    film = replace(FILM, thickness=1.0, density=FILM.stress)
    return ModalSystem(
        np.diag(squares), np.eye(5), FILM.stress, film, projection, (1.0, 1e9), layer
    )


@pytest.mark.parametrize("depth", [4e-3, 2e-2])
def test_a_compliant_clamp_holds_a_film_whose_stiffness_keeps_its_edge_from_turning(
    depth: float,
) -> None:
    layer = 5e-3
    clamped = stiff_string(layer, 1e-6)
    loose = stiff_string(layer, depth)
    system = held_string(clamped, layer)
    cubed = (depth - layer) ** 3 + layer**3
    found = library()["compliant_clamp"].changes["operators"](system, {"depth_cubed": cubed})
    shift = np.diag(found.stiffness) / clamped
    exact = loose / clamped
    # What it does to all alike stays in the speed of waves.
    np.testing.assert_allclose(shift / shift[0], exact / exact[0], rtol=0.05 * np.ptp(exact))


@pytest.mark.parametrize("depth", [4e-3, 2e-2])
def test_an_edge_between_springs_bends_its_layer_less(depth: float) -> None:
    layer = 5e-3
    clamped = stiff_string(layer, 1e-6)
    lengths = layer * np.linspace(0.9, 1.1, 7)
    each = np.array([stiff_string(length, 1e-6) for length in lengths])
    k2 = (np.sqrt(1 + 4 * lengths[:, None] ** 2 * each) - 1) / (2 * lengths[:, None] ** 2)
    system = replace(
        held_string(clamped, layer), layer=np.polynomial.polynomial.polyfit(lengths, k2, 3)
    )
    cubed = (depth - layer) ** 3 + layer**3
    found = library()["compliant_clamp"].changes["operators"](system, {"depth_cubed": cubed})
    followed = np.diag(found.stiffness - found.unbent) / np.diag(found.stiffness)
    step = 1 + 2e-2

    def share(depth: float) -> Array:
        by_layer = stiff_string(layer * step, depth) / stiff_string(layer / step, depth)
        return np.asarray(np.log(by_layer) / (4 * np.log(step)))

    exact = share(depth) / share(1e-6)
    np.testing.assert_allclose(followed, exact, rtol=0.05 * np.ptp(exact))
