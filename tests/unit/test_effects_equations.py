"""Each effect on its stage, against integrals over the film, steps in time and averages."""

from math import factorial

import numpy as np
import pytest
from numpy.polynomial.hermite_e import hermegauss
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from femnl.core.effect import Stage
from femnl.core.operators import Projection
from femnl.core.stages import (
    Equation,
    Fringe,
    Harmonics,
    Lines,
    ModalSystem,
    Motion,
    Oscillator,
    Placement,
    Points,
    Signal,
)
from femnl.core.tension import STRENGTHS, TensionChanges
from femnl.device.geometry import load
from femnl.effects import library
from femnl.optics.fringe import MultilayerFringe

Array = NDArray[np.float64]
MODEL = load("square-270um")
FILM = MODEL.film
WIDTH = 2.7e-4
HEIGHT = 1.8e-4
REACH = WIDTH / 2
ORDERS = [(1, 1), (1, 2), (2, 1), (2, 2)]
T, W = leggauss(40)
X, Y = np.meshgrid(T * WIDTH / 2, T * HEIGHT / 2)
AREA = np.outer(W, W) * WIDTH * HEIGHT / 4


def changed(name: str, stage: Stage, value: object, **values: float) -> object:
    """The value of a stage after an effect."""
    return library()[name].changes[stage](value, values)


def sines() -> tuple[Array, Array, Array]:
    """Modes sin·sin of the rectangle and their slopes, (n, y, x)."""
    found = []
    for m, n in ORDERS:
        p = m * np.pi / WIDTH
        q = n * np.pi / HEIGHT
        along = p * (X + WIDTH / 2)
        across = q * (Y + HEIGHT / 2)
        found.append(
            (
                np.sin(along) * np.sin(across),
                p * np.cos(along) * np.sin(across),
                q * np.sin(along) * np.cos(across),
            )
        )
    shape, slope_x, slope_y = (np.array(part) for part in zip(*found, strict=True))
    return shape, slope_x, slope_y


def within(slopes: Array) -> TensionChanges:
    """Return the changes of tension of first order, and the sides to eighth, within the modes."""
    even = slopes[:, 0] + slopes[:, 1]
    terms = [
        ("deviator", 1, slopes[0, 0] - slopes[0, 1]),
        ("shear", 1, 2 * slopes[0, 2]),
        ("x", 1, even[1]),
        ("y", 1, even[2]),
        ("bowl", 1, even[3] + even[5]),
    ]
    for k in range(1, 9):
        part = (-2) ** k * slopes[0, 0] + 2**k * slopes[0, 1]
        terms.append(("sides", k, part / factorial(k)))
    powers = [[power * (name == other) for other in STRENGTHS] for name, power, _ in terms]
    return TensionChanges(np.array(powers), np.array([part for _, _, part in terms]))


def system(bending_length: float = 0.0) -> ModalSystem:
    """Their stiffness and mass, with all integrals by quadrature."""
    shape, dx, dy = sines()
    x = X / REACH
    y = Y / REACH
    slopes = []
    masses = []
    for weight in (np.ones_like(x), x, y, x**2, x * y, y**2):
        pairs = [
            np.einsum("ixy,jxy,xy->ij", a, b, weight * AREA * FILM.thickness)
            for a, b in ((dx, dx), (dy, dy), (dx, dy))
        ]
        slopes.append([pairs[0], pairs[1], (pairs[2] + pairs[2].T) / 2])
        masses.append(
            np.einsum("ixy,jxy,xy->ij", shape, shape, weight * AREA * FILM.thickness * FILM.density)
        )
    axis = np.linspace(-REACH, REACH, 41)
    along, across = np.meshgrid(axis, np.clip(axis, -HEIGHT / 2, HEIGHT / 2))
    tables = np.array(
        [
            np.sin(m * np.pi * (along / WIDTH + 0.5)) * np.sin(n * np.pi * (across / HEIGHT + 0.5))
            for m, n in ORDERS
        ]
    )
    tension = within(np.array(slopes))
    projection = Projection(np.array(slopes), np.array(masses), REACH, axis, axis, tables, tension)
    stiffness = FILM.stress * (projection.slopes[0, 0] + projection.slopes[0, 1])
    k2 = np.diag(stiffness) / np.diag(projection.masses[0]) * FILM.density / FILM.stress
    return ModalSystem(
        stiffness * (1 + bending_length**2 * k2),
        projection.masses[0],
        FILM.stress,
        FILM,
        projection,
        (WIDTH, HEIGHT),
        bending_length,
    )


MIX = np.array([0.3, -1.0, 0.8, 0.5])
"""A motion of several modes at once, so that products of modes count."""


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("stress_anisotropy", {"anisotropy": 0.1}),
        ("shear_stress", {"shear": 0.04}),
        ("tension_gradient", {"slope_x": 0.1, "slope_y": -0.05, "bowl": 0.08}),
    ],
)
def test_a_stress_does_work_on_the_slopes_of_the_film(name: str, values: dict[str, float]) -> None:
    _, dx, dy = sines()
    wx = np.tensordot(MIX, dx, 1)
    wy = np.tensordot(MIX, dy, 1)
    xx, yy, xy = (np.zeros_like(X) for _ in range(3))
    if name == "stress_anisotropy":
        xx = xx + 1 + values["anisotropy"] / 2
        yy = yy + 1 - values["anisotropy"] / 2
    elif name == "shear_stress":
        xx = xx + 1
        yy = yy + 1
        xy = xy + values["shear"]
    else:
        even = (
            1
            + (values["slope_x"] * X + values["slope_y"] * Y) / REACH
            + values["bowl"] * (X**2 + Y**2) / REACH**2
        )
        xx = even
        yy = even
    energy = (
        FILM.thickness * FILM.stress * np.sum(AREA * (xx * wx**2 + yy * wy**2 + 2 * xy * wx * wy))
    )
    found = changed(name, "operators", system(), **values)
    assert isinstance(found, ModalSystem)
    assert MIX @ found.stiffness @ MIX == pytest.approx(energy, rel=1e-10)


def frequencies(value: object) -> Array:
    assert isinstance(value, ModalSystem)
    return np.asarray(np.sqrt(np.diag(value.stiffness) / np.diag(value.mass)) / (2 * np.pi))


def test_sides_in_another_ratio_change_the_waves_along_each() -> None:
    elongation = 0.02
    m, n = np.array(ORDERS).T
    exact = (
        np.hypot(m / (WIDTH * (1 + elongation / 2)), n * (1 + elongation / 2) / HEIGHT)
        * np.sqrt(FILM.stress / FILM.density)
        / 2
    )
    np.testing.assert_allclose(
        frequencies(changed("aspect_ratio", "operators", system(), elongation=elongation)),
        exact,
        rtol=1e-9,
    )


def test_bending_and_holes_change_the_frequency_of_a_wave_as_they_say() -> None:
    layer = 8e-7
    excess = 3e-13
    beta = 1e-13
    plain = system(layer)
    k2 = plain.wavenumber**2
    stiff = frequencies(changed("bending_stiffness", "operators", plain, excess=excess))
    np.testing.assert_allclose(
        (2 * np.pi * stiff / plain.speed) ** 2, k2 + excess * k2**2, rtol=1e-6
    )
    slow = frequencies(changed("hole_dispersion", "operators", plain, beta_area=beta))
    np.testing.assert_allclose(slow / frequencies(plain), 1 - beta * k2, rtol=1e-12)


def test_a_small_particle_lowers_each_mode_by_what_it_moves() -> None:
    mass = 1e-16
    x = 3e-5
    y = -2e-5
    shape = np.array(
        [
            np.sin(m * np.pi * (x / WIDTH + 0.5)) * np.sin(n * np.pi * (y / HEIGHT + 0.5))
            for m, n in ORDERS
        ]
    )
    light = system()
    found = changed("added_mass", "operators", light, mass=mass, x=x, y=y, spread=0.0)
    np.testing.assert_allclose(
        frequencies(found) / frequencies(light) - 1,
        -mass * shape**2 / (2 * np.diag(light.mass)),
        rtol=2e-4,
    )


def test_a_particle_on_a_soft_place_rides_on_it() -> None:
    light = system()
    mass = 2e-13
    spread = 3.0
    compliance = spread / (2 * np.pi * FILM.stress * FILM.thickness)
    added = changed("added_mass", "operators", light, mass=mass, x=0.0, y=0.0, spread=spread)
    assert isinstance(added, ModalSystem)
    square = light.stiffness[0, 0] / light.mass[0, 0]
    share = square * mass * compliance
    assert 0.01 < share < 0.1
    # A mass on a spring 1/G that a mode shakes at ω acts as m/(1 − ω²mG).
    assert added.mass[0, 0] - light.mass[0, 0] == pytest.approx(
        mass / (1 - share), rel=2 * share**3, abs=0
    )


OSCILLATOR = Oscillator(
    np.ones(3),
    0.02,
    0.0,
    0.0,
    0.0,
    np.array([0.1, 0.2, 0.4]),
    1.0,
    np.array([30.0, 10.0, 20.0]),
    np.ones(3),
    1.0,
    np.zeros(3, complex),
)

STAGES: tuple[tuple[Stage, object], ...] = (
    ("oscillator", OSCILLATOR),
    ("equation", Equation(0.0, 0.0, 0.0, 0.0)),
)


def test_damping_that_grows_takes_its_share_of_energy_in_each_period() -> None:
    eta = 2.0
    amplitude = 0.5
    gamma = 1e-4

    def lost(eta: float) -> float:
        run = solve_ivp(
            lambda t, s: [s[1], -s[0] - gamma * (1 + eta * s[0] ** 2) * s[1]],
            (0, 2 * np.pi),
            [amplitude, 0.0],
            "DOP853",
            rtol=1e-12,
        )
        return float(amplitude**2 - run.y[0, -1] ** 2 - run.y[1, -1] ** 2)

    for stage, plain in STAGES:
        found = changed("nonlinear_damping", stage, plain, eta=eta)
        assert isinstance(found, Oscillator | Equation)
        damping = found.damping
        assert lost(eta) / lost(0) == pytest.approx(1 + damping * amplitude**2 / 4, rel=1e-3)


def test_a_force_of_fifth_order_raises_the_free_oscillation_by_the_fourth_power() -> None:
    alpha5 = 0.4
    amplitude = 0.1

    def energy(u: Array | float) -> Array | float:
        return u**2 / 2 + alpha5 * u**6 / 6

    psi = np.pi * (np.arange(200) + 0.5) / 200
    u = amplitude * np.cos(psi)
    rate = 1 / np.mean(amplitude * np.sin(psi) / np.sqrt(2 * (energy(amplitude) - energy(u))))
    for stage, plain in STAGES:
        found = changed("quintic_stiffness", stage, plain, alpha5=alpha5)
        assert isinstance(found, Oscillator | Equation)
        quintic = found.quintic
        assert rate - 1 == pytest.approx(5 / 16 * quintic * amplitude**4, rel=1e-3)


def test_all_frequencies_drift_from_the_first_acquisition_on() -> None:
    time = np.array([30.0, 10.0, 20.0])
    rate = 1e-4
    later = 1 + rate * np.array([20.0, 0.0, 10.0])
    lines = changed(
        "frequency_drift", "frequencies", Lines(np.array([1.0, 2.0, 3.0]), time), rate=rate
    )
    sweeps = changed("frequency_drift", "oscillator", OSCILLATOR, rate=rate)
    points = changed(
        "frequency_drift", "points", Points(np.ones(3), np.ones(3), {"time": time}), rate=rate
    )
    assert isinstance(lines, Lines)
    assert isinstance(sweeps, Oscillator)
    assert isinstance(points, Points)
    np.testing.assert_allclose(lines.frequency, [1.0, 2.0, 3.0] * later, rtol=1e-14)
    np.testing.assert_allclose(sweeps.frequency, later, rtol=1e-14)
    np.testing.assert_allclose(points.frequency, later, rtol=1e-14)


def test_a_drive_in_compression_gives_half_its_force_where_the_term_is_one() -> None:
    found = changed("drive_compression", "oscillator", OSCILLATOR, kappa=1 / 0.2**2)
    assert isinstance(found, Oscillator)
    np.testing.assert_allclose(found.force, [0.1 / 1.25, 0.1, 0.4 / 5], rtol=1e-14)


def test_a_straight_fringe_bends_as_its_first_harmonic() -> None:
    amplitude = np.array([1e-8, 8e-8, 2e-7])
    wavelength = 633e-9
    share = 0.7
    tau = 2 * np.pi * np.arange(256) / 256
    z = np.sqrt(share) * 4 * np.pi * amplitude / wavelength
    first = 2 * np.mean(np.sin(z[:, None] * np.cos(tau)) * np.cos(tau), axis=1)
    plain = Signal(
        np.asarray(amplitude * 1e5, np.complex128),
        amplitude,
        np.ones(3),
        wavelength,
        1.0,
        np.zeros(3),
        np.ones(3),
    )
    found = changed("nonlinear_readout", "signal", plain, share=share)
    assert isinstance(found, Signal)
    np.testing.assert_allclose(found.voltage / plain.voltage, first / z, rtol=1e-10)


def test_warmth_gas_and_light_act_on_a_resonance_as_their_equations_say() -> None:
    control = {
        "temperature": np.array([290.0, 300.0, 310.0]),
        "pressure": np.array([0.0, 1.0, 10.0]),
        "laser_power": np.array([0.0, 1e-5, 1e-4]),
    }
    plain = Points(np.full(3, 1e6), np.full(3, 1e5), control)
    # Of the film less that of silicon
    expansion = FILM.young * (2.3e-6 - 2.6e-6) / (1 - FILM.poisson)
    stress = FILM.stress - expansion * (control["temperature"] - 300)
    warm = changed("thermal_stress", "points", plain, slope=expansion / FILM.stress)
    damped = changed("gas_damping", "points", plain, per_pressure=1e-6)
    lit = changed("photothermal", "points", plain, softening=2.0, loss=1e3)
    assert isinstance(warm, Points)
    assert isinstance(damped, Points)
    assert isinstance(lit, Points)
    np.testing.assert_allclose(warm.frequency, 1e6 * np.sqrt(stress / FILM.stress), rtol=1e-12)
    np.testing.assert_allclose(1 / damped.quality_factor, [1e-5, 1.1e-5, 2e-5], rtol=1e-12)
    np.testing.assert_allclose(lit.frequency, 1e6 * np.sqrt([1, 1 - 4e-5, 1 - 4e-4]), rtol=1e-14)
    np.testing.assert_allclose(1e5 / lit.quality_factor, [1, 1.01, 1.1], rtol=1e-12)


def test_a_film_that_warmth_slackens_has_no_frequency() -> None:
    control = {"temperature": np.array([290.0, 300.0, 310.0])}
    plain = Points(np.full(3, 1e6), np.full(3, 1e5), control)
    slack = changed("thermal_stress", "points", plain, slope=0.2)
    assert isinstance(slack, Points)
    np.testing.assert_allclose(slack.frequency, [1e6 * 3**0.5, 1e6, 0.0], rtol=1e-14)


def test_the_spot_of_a_gaussian_beam_has_half_its_radius_as_standard_deviation() -> None:
    radius = 3e-6
    s = np.linspace(-5 * radius, 5 * radius, 2001)
    power = np.exp(-2 * s**2 / radius**2)
    found = changed(
        "finite_spot", "placement", Placement(np.zeros(1), np.zeros(1), 2e-6), radius=radius
    )
    assert isinstance(found, Placement)
    assert found.spot == pytest.approx(
        np.hypot(2e-6, np.sqrt(np.sum(power * s**2) / np.sum(power))), rel=1e-9
    )


def test_harmonics_behind_a_low_pass_and_an_unsteady_trigger() -> None:
    frequency = 1.5e6
    sd = 2e-8
    tau = 1.2e-8
    plain = Harmonics(np.ones((3, 1), complex), np.array([1, 2, 3]), frequency)
    omega = 2 * np.pi * frequency * plain.harmonic
    late, share = hermegauss(40)
    worn = changed("trigger_jitter", "harmonics", plain, sd=sd)
    slow = changed("detector_bandwidth", "harmonics", plain, time_constant=tau)
    assert isinstance(worn, Harmonics)
    assert isinstance(slow, Harmonics)
    np.testing.assert_allclose(
        worn.values[:, 0],
        np.exp(-1j * np.outer(omega, sd * late)) @ share / share.sum(),
        atol=1e-12,
    )
    for n, w in enumerate(omega):
        answer = low_passed(float(w), tau)
        # The delay τ, the same for all harmonics, counts to the motion.
        assert slow.values[n, 0] == pytest.approx(answer * np.exp(1j * w * tau), abs=1e-6)


def low_passed(omega: float, tau: float) -> complex:
    """Answer of τ v̇ + v = cos ωt, once it is steady, in terms of e^{iωt}."""

    def rate(t: float, v: Array) -> Array:
        return np.asarray((np.cos(omega * t) - v) / tau)

    t = 30 * tau + 2 * np.pi / omega * np.arange(64) / 64
    run = solve_ivp(rate, (0, t[-1]), [0.0], "DOP853", rtol=1e-11, atol=1e-13, t_eval=t)
    return complex(2 * np.mean(run.y[0] * np.exp(-1j * omega * t)))


def test_the_fringe_of_a_stack_is_its_reflection_at_the_gap_that_the_film_leaves() -> None:
    assert MODEL.stack is not None
    wavelength = 632.8e-9
    more = 4e-8
    gap = MODEL.stack.layers[MODEL.stack.gap].thickness
    found = changed(
        "multilayer_fringe",
        "fringe",
        Fringe(np.array([0, 1 + 0j]), wavelength, MODEL.stack),
        gap=gap + more,
        thickness=FILM.thickness,
        index_scale=1.0,
        aperture_square=0.0,
    )
    assert isinstance(found, Fringe)
    u = np.linspace(-2e-7, 2e-7, 33)
    turns = np.exp(4j * np.pi / wavelength * np.outer(u, np.arange(len(found.coefficients))))
    v = (turns @ found.coefficients).real
    exact = MultilayerFringe(MODEL.stack, wavelength)(u + more)
    # Of the reflection, only its form counts: the contrast and its mean belong to the detector.
    scale, offset = np.polyfit(exact, v, 1)
    assert scale > 0
    np.testing.assert_allclose(v, scale * exact + offset, atol=1e-6)
    assert abs(found.coefficients[1]) == pytest.approx(1, rel=1e-12)


def test_other_modes_are_mixed_into_the_driven_one_in_their_order() -> None:
    shapes = np.arange(1.0, 13.0).reshape(6, 2)
    swing = np.array([1e-7, 2e-7]) * np.exp(0.3j)
    plain = Motion(
        (swing * shapes[1])[None],
        np.zeros(2),
        np.zeros(2),
        np.zeros(2),
        shapes,
        np.arange(1.0, 7.0),
        1,
        swing,
        633e-9,
    )
    found = changed(
        "mode_admixture",
        "motion",
        plain,
        e1=0.1,
        e2=0.2,
        e3=-0.3,
        e4=0.05,
        e5=0.02,
        q1=0.0,
        q2=-0.4,
        q3=0.0,
        q4=0.0,
        q5=0.1,
    )
    assert isinstance(found, Motion)
    mixed = (
        shapes[1]
        + 0.1 * shapes[0]
        + (0.2 - 0.4j) * shapes[2]
        - 0.3 * shapes[3]
        + 0.05 * shapes[4]
        + (0.02 + 0.1j) * shapes[5]
    )
    np.testing.assert_allclose(found.displacement, (swing * mixed)[None], rtol=1e-14)
