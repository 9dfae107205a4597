"""The driven resonator against direct time integration, and against closed forms."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from femnl.core.errors import ParameterError
from femnl.core.resonator import Array, Complex, CoupledModes, Resonator
from femnl.resonator import (
    balance,
    branches,
    couple,
    critical_alpha,
    critical_point,
    curve,
    duffing_roots,
    sweep_modes,
)
from femnl.resonator.roots import continued, self_stiffened

Force = Callable[[float, Array], Array]
# All tests count time in 1/ω₀ and displacement in units of 1/√α, where the equations have no small
# or large numbers.
F0 = 1 / (2 * np.pi)


def shoot(force: Force, omega: float, state: Array, n_samples: int = 64) -> tuple[Array, Complex]:
    """Find the periodic orbit near `state` by Newton on the period map.

    Return displacement samples and the multipliers.
    """
    n = len(state)
    period = 2 * np.pi / omega

    def period_map(start: Array) -> Array:
        times = np.linspace(0, period, n_samples + 1)
        return np.asarray(
            solve_ivp(force, (0, period), start, "DOP853", times, rtol=1e-12, atol=1e-14).y
        )

    for _ in range(12):
        orbit = period_map(state)
        step = 1e-6
        columns = [
            (period_map(state + step * e)[:, -1] - period_map(state - step * e)[:, -1]) / (2 * step)
            for e in np.eye(n)
        ]
        monodromy = np.stack(columns, axis=1)
        change = np.linalg.solve(monodromy - np.eye(n), orbit[:, -1] - state)
        state = state - change
        if np.linalg.norm(change) < 1e-11:
            return period_map(state)[: n // 2, :-1], np.asarray(
                np.linalg.eigvals(monodromy), dtype=complex
            )
    raise AssertionError("shooting did not converge")


PHASE: Array = np.linspace(0, 2 * np.pi, 64, endpoint=False)

MODES = {
    "cubic": Resonator(F0, 50, alpha=1.0),
    "softening": Resonator(F0, 50, alpha=-1.0),
    "quadratic": Resonator(F0, 50, alpha=1.0, quadratic=0.6),
    "quintic": Resonator(F0, 50, alpha=1.0, quintic=0.8),
    "damping": Resonator(F0, 50, alpha=1.0, nonlinear_damping=2.5),
    "everything": Resonator(F0, 60, alpha=0.7, quadratic=0.3, quintic=0.5, nonlinear_damping=2.0),
}


@pytest.mark.parametrize("name", MODES)
@pytest.mark.parametrize("shift", [-0.02, 0.005, 0.03])
def test_harmonic_balance_meets_time_integration_on_every_branch(name: str, shift: float) -> None:
    mode = MODES[name]
    omega = 1 + (shift if name != "softening" else -shift)
    force = 0.006

    def rate(t: float, s: Array) -> Array:
        u, v = s
        pull = u + mode.quadratic * u**2 + mode.alpha * u**3 + mode.quintic * u**5
        return np.array(
            [
                v,
                force * np.cos(omega * t)
                - mode.damping * (1 + mode.nonlinear_damping * u**2) * v
                - pull,
            ]
        )

    found = balance(mode, force, omega * F0, 14)
    assert len(found.frequency) == np.isfinite(branches(mode, force, [omega * F0]).amplitude).sum()
    q = found.at(PHASE)[:, 0]
    for p in range(len(found.frequency)):
        order = np.arange(found.coefficients.shape[-1])
        speed = (found.coefficients[p, 0] * 1j * order * omega).real.sum()
        orbit, multipliers = shoot(rate, omega, np.array([q[p, 0], speed]))
        np.testing.assert_allclose(q[p], orbit[0], atol=1e-9 * np.abs(orbit).max())
        np.testing.assert_allclose(
            np.sort_complex(found.multipliers[p]), np.sort_complex(multipliers), atol=2e-7
        )
        assert found.stable[p] == (np.abs(multipliers).max() < 1)


@pytest.mark.parametrize(
    "ratio", [1.37, 2.0, 3.0], ids=["dispersive", "one to two", "one to three"]
)
def test_coupled_modes_meet_time_integration(ratio: float) -> None:
    second = ratio * 1.001
    k2, k3, k31 = (
        (0.12, 0.0, 0.0) if ratio == 2 else (0.0, 0.4, 0.0) if ratio < 2 else (0.0, 0.4, 0.3)
    )
    mass = np.array([1.0, 0.5])
    modes = couple(
        [Resonator(F0, 40, alpha=0.5), Resonator(second * F0, 60, alpha=0.8)],
        mass,
        quadratic={(0, 0, 1): k2} if k2 else None,
        cubic={(0, 0, 1, 1): k3, (0, 0, 0, 1): k31},
    )
    omega = 1.01
    force = np.array([0.008, 0.0])

    def rate(t: float, s: Array) -> Array:
        # Forces from the potential K2 q₁²q₂ + (3/2) K3 q₁²q₂² + K31 q₁³q₂, and each mode's own
        # terms.
        q1, q2, v1, v2 = s
        f1 = 2 * k2 * q1 * q2 + 3 * k3 * q1 * q2**2 + 3 * k31 * q1**2 * q2
        f2 = k2 * q1**2 + 3 * k3 * q1**2 * q2 + k31 * q1**3
        a1 = force[0] * np.cos(omega * t) - v1 / 40 - q1 - 0.5 * q1**3 - f1 / mass[0]
        a2 = -v2 * second / 60 - second**2 * (q2 + 0.8 * q2**3) - f2 / mass[1]
        return np.array([v1, v2, a1, a2])

    motion = sweep_modes(modes, force, np.linspace(0.9, omega, 12) * F0, 16)
    order = np.arange(17)
    last = motion.coefficients[-1]
    orbit, multipliers = shoot(
        rate,
        omega,
        np.concatenate([last.real.sum(axis=1), (last * 1j * order * omega).real.sum(axis=1)]),
    )
    assert np.abs(orbit[1]).max() > 1e-3 * np.abs(orbit[0]).max() or ratio < 2
    np.testing.assert_allclose(motion.at(PHASE)[-1], orbit, atol=1e-9 * np.abs(orbit).max())
    np.testing.assert_allclose(
        np.abs(motion.multipliers[-1]).max(), np.abs(multipliers).max(), atol=2e-7
    )


def test_a_dispersively_coupled_mode_is_pumped_parametrically_once_the_drive_is_strong() -> None:
    # q₁ = U cos ωt makes ω₂² → ω₂² + (3/2)K₃U²(1 + cos 2ωt): a Mathieu tongue about ω₂² = ω² −
    # (3/2)K₃U² of half width (3/4)K₃U².
    def growth(force: float, second: float) -> float:
        modes = couple(
            [Resonator(F0, 100), Resonator(second * F0, 1000)],
            [1.0, 1.0],
            cubic={(0, 0, 1, 1): 0.2},
        )
        motion = sweep_or_curve_end(modes, force)
        return float(np.abs(motion).max())

    amplitude = 0.2
    force = amplitude / 100
    shift = 1.5 * 0.2 * amplitude**2
    assert growth(force, np.sqrt(1 - shift)) > 1
    assert growth(force / 20, np.sqrt(1 - shift)) < 1
    for edge in (-0.65, 0.65):
        assert growth(force, np.sqrt(1 - shift * (1 + edge))) < 1


def sweep_or_curve_end(modes: CoupledModes, force: float) -> Complex:
    """Multipliers of the motion in which only the driven mode moves, at its resonance."""
    return np.asarray(curve(modes, [force, 0.0], 0.9 * F0, F0, 4).multipliers[-1])


@pytest.mark.parametrize("stiffening", [0, 1e-9, 0.3, 1.6, -8, 80, -1e4])
@pytest.mark.parametrize("damping", [0, 0.3, 4])
def test_amplitude_roots_solve_their_equation_and_none_is_missed(
    stiffening: float, damping: float
) -> None:
    detuning = np.linspace(-2, 2, 301) * (10 + abs(stiffening))
    x = duffing_roots(detuning, stiffening, damping)

    def excess(x: Array, delta: Array) -> Array:
        return np.asarray(x * ((delta + stiffening * x) ** 2 + (1 + damping * x) ** 2) - 1)

    assert np.nanmax(np.abs(excess(x, detuning))) < 1e-11
    for column, delta in zip(x.T, detuning, strict=True):
        roots = column[np.isfinite(column)]
        beside = np.concatenate([roots * (1 - 1e-8), roots * (1 + 1e-8)])
        signs = np.sign(
            excess(np.sort(np.concatenate([np.geomspace(1e-12, 1.1, 2000), beside])), delta)
        )
        assert np.count_nonzero(np.diff(signs)) == len(roots)
        assert np.all(np.diff(roots) >= 0)


@pytest.mark.parametrize("loss", [0.0, 0.2, 0.9])
def test_three_states_appear_just_above_the_critical_force(loss: float) -> None:
    # Q is high because the Lorentzian form moves the critical force by 1/Q, and the amplitude there
    # by its cube root.
    mode = Resonator(1e6, 1e9, alpha=1e10, nonlinear_damping=loss * np.sqrt(3) * 1e10 * 1e9)
    force, frequency, amplitude = critical_point(mode)
    # Just above, three states share a window of ε^(3/2) linewidths only.
    near = frequency + np.linspace(-0.02, 0.02, 20001) * mode.linewidth
    counts = [
        np.isfinite(branches(mode, force * factor, near).amplitude).sum(axis=1).max()
        for factor in (1 - 2e-3, 1 + 2e-3)
    ]
    assert counts == [1, 3]
    found = np.abs(branches(mode, force, [frequency]).amplitude[0])
    np.testing.assert_allclose(found[np.isfinite(found)], amplitude, rtol=5e-3)
    if loss == 0:
        peak = force / (mode.omega * mode.damping)
        np.testing.assert_allclose(
            critical_alpha(mode.frequency, mode.linewidth, peak), mode.alpha, rtol=1e-12
        )


def test_no_critical_point_exists_where_damping_grows_faster_than_stiffness() -> None:
    eta = np.sqrt(3) * 1e10 * 1e4
    critical_point(Resonator(1e6, 1e4, alpha=1e10, nonlinear_damping=0.999 * eta))
    with pytest.raises(ParameterError, match="never makes the response vertical"):
        critical_point(Resonator(1e6, 1e4, alpha=1e10, nonlinear_damping=1.001 * eta))


@pytest.mark.parametrize("sign", [pytest.param(1, marks=pytest.mark.slow), -1])
def test_sweeps_jump_at_the_folds_of_the_curve_and_differ_between_them(sign: int) -> None:
    mode = Resonator(F0, 100, alpha=sign * 0.3)
    force = 2 * critical_point(mode)[0]
    ends = (0.93 * F0, 1.07 * F0)
    whole = curve(couple([mode]), [force], *ends, 5)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(whole.frequency)))) + 1
    assert len(turns) == 2
    folds = np.sort(whole.frequency[turns])
    assert not whole.stable[turns[0] + 1 : turns[1]].any()
    assert whole.stable[: turns[0] - 1].all()
    assert whole.stable[turns[1] + 2 :].all()
    grid = np.linspace(*ends, 141)
    up = np.abs(sweep_modes(couple([mode]), [force], grid, 5).coefficients[:, 0, 1])
    down = np.abs(sweep_modes(couple([mode]), [force], grid[::-1], 5).coefficients[:, 0, 1])[::-1]
    spacing = grid[1] - grid[0]
    inside = (grid > folds[0] + spacing) & (grid < folds[1] - spacing)
    outside = (grid < folds[0] - spacing) | (grid > folds[1] + spacing)
    assert np.all(np.abs(up - down)[inside] > 0.1 * up.max())
    np.testing.assert_allclose(up[outside], down[outside], rtol=1e-9)
    for fold, path in zip(folds[::-1], (up, down), strict=True):
        jump = np.argmax(np.abs(np.diff(path)))
        assert grid[jump] - spacing <= fold <= grid[jump + 1] + spacing


@pytest.mark.parametrize(("fifth", "pull"), [(0.2, 0.0), (-0.1, 0.0), (0.0, 0.3), (0.2, 0.3)])
def test_states_that_their_own_amplitude_stiffens_rest(fifth: float, pull: float) -> None:
    """X |δ + a(x) x + i|² = 1 with a(x) = c + q x + p s x, Im a the damping."""
    delta = np.linspace(8, -8, 97)
    cubic = np.full(97, 2.0 + 0.05j)
    quintic = np.full(97, fifth)
    pulled = np.asarray(-pull / (3 - delta + 0.2j), complex)
    scale = np.full(97, 2.0)
    x = np.ones((2, 97))
    self_stiffened(x, delta, (cubic, quintic, pulled), scale, 3.0)
    a = cubic + quintic * x + pulled * scale * x
    rests = np.abs(x * np.abs(delta + a * x + 1j) ** 2 - 1) < 1e-8
    # Where one branch has ended the other one rests
    assert rests.any(axis=0).all()
    assert rests.mean() > 0.7


@pytest.mark.parametrize("damping", [0.0, 0.1])
@pytest.mark.parametrize("fifth", [0.04, -0.04])
def test_states_that_a_quintic_term_moves_a_little_are_roots_of_the_whole_equation(
    fifth: float, damping: float
) -> None:
    """X |δ + i + c x + q x²|² = 1 as a quintic in x, by its companion matrix."""
    delta = np.linspace(-6, 3, 361)
    cubic = np.full(delta.size, 4.0 + damping * 1j)
    roots = duffing_roots(delta, 4.0, damping)
    x = np.stack([roots[0], np.fmax(roots[0], roots[2])])
    none = np.zeros(delta.size)
    self_stiffened(
        x, delta, (cubic, np.full(delta.size, fifth), none.astype(complex)), none + 1, 3.0
    )
    counted = {1: 0, 3: 0}
    for k, states in enumerate(x.T):
        inner = np.array([fifth, cubic[k], delta[k] + 1j])
        found = np.roots(np.append(np.convolve(inner, inner.conj()).real, -1.0))
        real = np.sort(found[(np.abs(found.imag) < 1e-9) & (found.real > 0) & (found.real < 1)])
        # Past a fold of either equation a branch is continued
        count = int(np.isfinite(roots[:, k]).sum())
        if real.size == count and (count == 3 or delta[k] > -1):
            np.testing.assert_allclose(states, real[[0, -1]].real, rtol=1e-8)
            counted[count] += 1
    assert counted[1] > 150
    assert counted[3] > 20


@pytest.mark.parametrize("pull", [10.0, 94.0, 300.0])
def test_states_that_another_mode_pulls_strongly_are_roots_of_the_whole_equation(
    pull: float,
) -> None:
    """X |δ + i + c x + p s x²|² = 1 as a quintic in x, by its companion matrix."""
    delta = np.linspace(-12, 8, 201)
    cubic = np.full(delta.size, 16.4 + 0j)
    pulled = np.asarray(-pull / (delta + 5.5 + 0.92j), complex)
    x = np.stack([duffing_roots(delta, 16.4)[0]] * 2)
    self_stiffened(x, delta, (cubic, np.zeros(delta.size), pulled), np.full(delta.size, 8.2), 3.0)
    several = 0
    for k in range(delta.size):
        inner = np.array([8.2 * pulled[k], cubic[k], delta[k] + 1j])
        quintic = np.append(np.convolve(inner, inner.conj()).real, -1.0)
        found = np.roots(quintic)
        roots = np.sort(found[(np.abs(found.imag) < 1e-9) & (found.real > 0)].real)
        near = [np.abs(roots / state - 1).min() < 1e-6 for state in x[:, k]]
        assert any(near)
        if abs(x[1, k] / x[0, k] - 1) < 1e-8 and roots[-1] > 1.06 * roots[0]:
            several += 1
    assert several == 0


@pytest.mark.parametrize("damping", [0.0, 0.3])
@pytest.mark.parametrize("stiffening", [4.0, -6.0])
def test_a_branch_goes_on_past_its_fold_by_the_real_part_of_the_complex_roots(
    stiffening: float, damping: float
) -> None:
    """X [(δ + ax)² + (1 + dx)²] = 1 as a cubic, by the eigenvalues of its companion matrix."""
    detuning = np.linspace(-15, 15, 61)
    x = duffing_roots(detuning, stiffening, damping)
    both = np.array([x[0], np.where(np.isfinite(x[2]), x[2], x[0])])
    single = ~np.isfinite(x[2])
    before = both.copy()
    ended = continued(both, detuning, stiffening, damping)
    assert ended.any(axis=1).all()
    assert np.array_equal(both[~ended], before[~ended])
    assert not ended[:, ~single].any()
    for side, k in np.argwhere(ended):
        delta = detuning[k]
        cubic = stiffening**2 + damping**2
        roots = np.roots([cubic, 2 * (stiffening * delta + damping), delta**2 + 1, -1])
        pair = roots[np.abs(roots.imag) > 1e-9]
        assert both[side, k] == pytest.approx(pair.real.mean(), rel=1e-9)
