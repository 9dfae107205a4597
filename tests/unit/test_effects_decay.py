"""Effects on decays against steps in time, quadratures, closed forms and Fourier transforms."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from femnl.core.stages import Dissipation, Reading, Ringing
from femnl.effects import library
from femnl.observe.decay.model import decayed

Array = NDArray[np.float64]
RATE = 0.4
TIME = np.linspace(0, 25, 200)
LEVEL = np.linspace(0, -18, 1200)
IDLE = Dissipation(LEVEL, np.full(len(LEVEL), RATE), RATE, np.zeros(len(LEVEL)))


def changed(name: str, stage: str, value: object, **values: float) -> object:
    """The value of a stage after an effect."""
    return library()[name].changes[stage](value, values)


def energy(**causes: dict[str, float]) -> tuple[Array, Array]:
    """Return ln of the energy and the phase under effects on the dissipation."""
    mode = IDLE
    for name, values in causes.items():
        found = changed(name, "dissipation", mode, **values)
        assert isinstance(found, Dissipation)
        mode = found
    return decayed(mode, TIME)


def test_a_mode_alone_decays_exponentially_beyond_all_levels() -> None:
    short = Dissipation(LEVEL[:100], IDLE.rate[:100], RATE, IDLE.pull[:100])
    np.testing.assert_allclose(decayed(short, TIME)[0], -RATE * TIME, atol=1e-12)


def test_nonlinear_damping_is_the_equation_of_motion_averaged_over_a_period() -> None:
    """Steps of u″ + γ(1 + ηu²)u′ + u = 0 over 40 periods, energy by its turning points."""
    gamma = 4e-3
    eta = 6.0
    mode = Dissipation(LEVEL, np.full(len(LEVEL), gamma), gamma, np.zeros(len(LEVEL)))
    run = solve_ivp(
        lambda t, s: [s[1], -s[0] - gamma * (1 + eta * s[0] ** 2) * s[1]],
        (0, 80 * np.pi),
        [1.0, 0.0],
        "DOP853",
        t_eval=2 * np.pi * np.arange(41),
        rtol=1e-11,
        atol=1e-12,
    )
    found = changed("nonlinear_damping", "dissipation", mode, eta=eta)
    assert isinstance(found, Dissipation)
    expected = np.log(run.y[0] ** 2 + run.y[1] ** 2)
    np.testing.assert_allclose(decayed(found, run.t)[0], expected, atol=3e-3)
    assert expected[-1] < -1.5


def test_nonlinear_damping_has_the_closed_form() -> None:
    """E = e^{−γt}/(1 + d(1 − e^{−γt})), d = η/4: Polunin et al., 2016."""
    d = 5.0
    expected = -RATE * TIME - np.log1p(-d * np.expm1(-RATE * TIME))
    found, _ = energy(nonlinear_damping={"eta": 4 * d})
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_an_exchange_of_energy_has_two_rates_and_a_corner_at_its_threshold() -> None:
    found, _ = energy(energy_exchange={"excess": 3.0, "threshold": -2.0})
    corner = 2.0 / (4 * RATE)
    expected = np.where(corner > TIME, -4 * RATE * TIME, -2.0 - RATE * (TIME - corner))
    np.testing.assert_allclose(found, expected, atol=0.03)


def test_causes_of_dissipation_add_their_rates() -> None:
    """Beside damping in closed steps: dE/dt of both, by a solver of its own."""
    both, _ = energy(
        nonlinear_damping={"eta": 4.0}, energy_exchange={"excess": 1.0, "threshold": -1.0}
    )

    def flow(t: float, x: Array) -> Array:
        above = np.clip((x + 1.0) / 0.06 + 0.5, 0, 1)
        return -RATE * (1 + np.exp(x) + above)

    run = solve_ivp(flow, (0, TIME[-1]), [0.0], t_eval=TIME, rtol=1e-9, max_step=0.01)
    np.testing.assert_allclose(both, run.y[0], atol=2e-3)


def test_a_frequency_that_follows_the_energy_turns_the_phase_by_its_integral() -> None:
    """2π ∫ s e^{−γt} dt = 2πs (1 − e^{−γt})/γ."""
    _, angle = energy(duffing_shift={"shift": 0.7})
    np.testing.assert_allclose(angle, -2 * np.pi * 0.7 * np.expm1(-RATE * TIME) / RATE, atol=2e-3)


def test_a_stiffening_spring_has_the_shift_of_duffing() -> None:
    """Phase of u″ + u + αu³ = 0 after ten periods against ⅜αA²."""
    alpha = 4e-3
    run = solve_ivp(
        lambda t, s: [s[1], -s[0] - alpha * s[0] ** 3],
        (0, 20 * np.pi),
        [1.0, 0.0],
        "DOP853",
        rtol=1e-12,
        atol=1e-12,
    )
    late = np.arctan2(-run.y[1, -1], run.y[0, -1])
    near = np.linspace(0, -1e-6, 50)
    idle = Dissipation(near, np.full(50, 1e-9), 1e-9, np.zeros(50))
    shift = 3 / 8 * alpha / (2 * np.pi)
    found = changed("duffing_shift", "dissipation", idle, shift=shift)
    assert isinstance(found, Dissipation)
    assert late == pytest.approx(float(decayed(found, run.t[-1:])[1][0]), rel=0.01)


def test_the_phase_of_a_drifting_mode_is_the_integral_of_its_frequency() -> None:
    plain = Ringing(TIME, np.ones(len(TIME), complex), RATE, 1e6)
    found = changed("frequency_drift", "ringing", plain, rate=1e-9)
    assert isinstance(found, Ringing)
    steps = 1e-3 * TIME
    expected = 2 * np.pi * np.concatenate([[0], np.cumsum((steps[1:] + steps[:-1]) / 2)])
    expected *= TIME[1]
    np.testing.assert_allclose(np.unwrap(np.angle(found.amplitude)), expected, atol=1e-9)


def test_a_pair_beats_at_its_splitting() -> None:
    """Spectrum of the power without decay: lines at 0 and at ±Δ, of 1 + r² and r."""
    time = np.arange(256) / 64
    plain = Ringing(time, np.ones(256, complex), RATE, 0.0)
    values = {"in_phase": 0.3, "quadrature": 0.4, "splitting": 3.0, "partner_rate": 0.0}
    found = changed("beating_pair", "ringing", plain, **values)
    assert isinstance(found, Ringing)
    lines = np.fft.fft(np.abs(found.amplitude) ** 2) / 256
    assert lines[0].real == pytest.approx(1.25)
    assert abs(lines[12]) == pytest.approx(0.5)
    assert np.abs(np.delete(lines, [0, 12, 244])).max() < 1e-12


def test_a_leak_stays_and_is_gone_without_the_generator() -> None:
    plain = Reading(TIME, np.ones(len(TIME)), np.zeros(len(TIME), complex))
    values = {"in_phase": 0.03, "quadrature": -0.04, "offset": 0.2}
    found = changed("feed_through", "reading", plain, **values)
    assert isinstance(found, Reading)
    np.testing.assert_allclose(np.abs(found.added), 0.05)
    turned = np.unwrap(np.angle(found.added))
    np.testing.assert_allclose(np.diff(turned) / np.diff(TIME), 2 * np.pi * 0.2)
    off = Reading(TIME, plain.gain, plain.added, drive=False)
    without = changed("feed_through", "reading", off, **values)
    assert isinstance(without, Reading)
    assert not np.any(without.added)


def test_a_mode_that_leaves_a_gaussian_filter_falls_as_its_chirp_behind_the_filter() -> None:
    """A chirp multiplied by the filter's response in Fourier space, against e^{−(t/T)²}."""
    width = 40.0  # Hz at −3 dB
    pace = 6.0  # Hz/s
    time = np.arange(2**15) / 2000
    chirp = np.exp(1j * np.pi * pace * (time - time[-1] / 2) ** 2)
    away = np.fft.fftfreq(len(time), time[1])
    behind = np.fft.ifft(np.fft.fft(chirp) * 2 ** (-0.5 * (2 * away / width) ** 2))
    plain = Reading(TIME, np.ones(len(TIME)), np.zeros(len(TIME), complex))
    exit_rate = (2 * np.sqrt(np.log(2)) * pace / width) ** 2
    found = changed("filter_exit", "reading", plain, exit_rate=exit_rate)
    assert isinstance(found, Reading)
    near = TIME < 5
    seen = np.interp(TIME[near], time - time[-1] / 2, np.abs(behind))
    np.testing.assert_allclose(found.gain[near], seen, atol=5e-3)
    assert found.gain[near].min() < 0.5
    wider = Reading(TIME, plain.gain, plain.added, bandwidth=2.0)
    less = changed("filter_exit", "reading", wider, exit_rate=exit_rate)
    assert isinstance(less, Reading)
    np.testing.assert_allclose(np.log(less.gain), np.log(found.gain) / 4)


def test_the_working_point_gives_the_first_harmonic_of_the_fringe() -> None:
    """Of a small motion under sin(φ + ε cos τ), by the mean over a period."""
    plain = Reading(TIME, np.ones(len(TIME)), np.zeros(len(TIME), complex))
    found = changed("working_point", "reading", plain, turn=0.05, phase=0.6)
    assert isinstance(found, Reading)
    tau = 2 * np.pi * np.arange(64) / 64
    place = 0.6 + 0.05 * TIME
    first = np.sin(place[:, None] + 1e-4 * np.cos(tau)) @ np.cos(tau)
    np.testing.assert_allclose(found.gain, first / first[0], atol=1e-6)
    assert found.gain.min() < 0 < found.gain.max()
