"""Fits of driven responses against simulated truth."""

from typing import Any

import numpy as np
import pytest
import xarray as xr

from femnl.core.choices import Use
from femnl.core.errors import MeasurementError, ParameterError
from femnl.core.fit import Fit
from femnl.core.resonator import Array, Complex, Resonator
from femnl.fits.response.fit import fit_response, predict_response
from femnl.fits.response.linescan import fit_line_scan
from femnl.fits.response.misfit import Misfit, rice
from femnl.io.measurement import response
from femnl.observe.response.branches import STIFFEN, fold
from femnl.observe.response.sweeps import collect
from femnl.observe.response.theta import Layout
from femnl.resonator import critical_alpha, duffing_roots, sweep

F0 = 2.932e6
Q = 7.4e5
ALPHA = 2.3e10
MODE = Resonator(F0, Q, alpha=ALPHA)
# Force per drive voltage so that 1 V drives the mode to α_y/α_c = 10: α A² = 10 (32√3/27)/Q at the
# linear peak A = 𝓕/γω₀.
PEAK = np.sqrt(10 * 32 * np.sqrt(3) / 27 / Q / ALPHA)
FORCE = PEAK * MODE.omega * MODE.damping
# Responsivity [V/m] that makes this 0.17 V.
GAIN = 0.17 / PEAK


def simulate(
    mode: Resonator = MODE,
    drives: tuple[float, ...] = (0.1, 0.3, 1.0),
    *,
    gain: tuple[complex, ...] = (GAIN * np.exp(0.7j),),
    noise: float = 2e-4,
    points: int = 151,
    delay: float = 0.0,
    seed: int = 0,
    distort: bool = False,
) -> xr.Dataset:
    """Return up and down sweeps at each drive and place, followed through their jumps."""
    rng = np.random.default_rng(seed)
    # The grid moves with the seed, so that a fold may lie anywhere between two points.
    frequency = (
        mode.frequency
        + (np.linspace(-4, 13, points) + rng.uniform(0, 17 / points)) * mode.linewidth
    )
    rows: list[tuple[Complex, float, int, float]] = []
    for drive in drives:
        for direction in (1, -1):
            motion = sweep(mode, FORCE * drive, frequency[::direction])[::direction]
            for place, g in enumerate(gain):
                v = g * motion * np.exp(-2j * np.pi * (frequency - mode.frequency) * delay)
                if distort:
                    v = v * np.sinc(2.2 * np.abs(motion) / np.max(np.abs(motion)))
                rows.append(
                    (
                        v + noise * (rng.normal(size=points) + 1j * rng.normal(size=points)),
                        drive,
                        direction,
                        place * 1e-5,
                    )
                )
    volts, drive_of, direction_of, x = zip(*rows, strict=True)
    zeros = np.zeros(len(x))
    return response(
        frequency,
        np.array(volts),
        drive=drive_of,
        direction=direction_of,
        x=x,
        y=zeros,
        noise_sd=noise,
    )


def pull(fit: Fit, name: str, truth: float) -> float:
    return (fit[name] - truth) / fit.parameters[name].sd


@pytest.mark.parametrize("use", ["complex", "magnitude", "phase", "phase-mod-pi"])
def test_all_sweeps_together_give_back_the_resonator(use: Use) -> None:
    fit = fit_response(simulate(delay=3e-5), use, force_per_volt=FORCE)
    assert abs(pull(fit, "frequency", F0)) < 4
    assert abs(pull(fit, "quality_factor", Q)) < 4
    assert abs(pull(fit, "alpha_ratio", 10.0)) < 4
    assert abs(pull(fit, "alpha", ALPHA)) < 4
    assert fit.parameters["alpha"].sd < 0.02 * ALPHA
    if use != "magnitude":
        assert abs(pull(fit, "delay", 3e-5)) < 4
        turned = np.angle(np.exp(1j * (fit["phase"] - 0.7)) ** (2 if use == "phase-mod-pi" else 1))
        assert abs(turned) < 8 * fit.parameters["phase"].sd
    assert 0.8 < fit.chi2_reduced < 1.2


def test_alpha_in_metres_is_the_same_by_force_and_by_responsivity() -> None:
    data = simulate(gain=(GAIN + 0j, GAIN / 3 + 0j))
    by_force = fit_response(data, force_per_volt=FORCE)
    by_reading = fit_response(data, responsivity=[GAIN, GAIN / 3])
    assert abs(pull(by_reading, "alpha", ALPHA)) < 4
    assert abs(pull(by_force, "alpha", ALPHA)) < 4
    np.testing.assert_allclose(
        by_force["alpha_y[0]"] / by_force["alpha_y[1]"], (1 / 3) ** 2, rtol=0.01
    )
    assert by_force["alpha_y[0]"] == pytest.approx(
        by_force["alpha_ratio"]
        * critical_alpha(
            by_force["frequency"], by_force["linewidth"], by_force["y_max[0]"] * by_force["drive"]
        )
    )


@pytest.mark.slow
def test_phase_modulo_pi_survives_a_readout_that_turns_the_sign() -> None:
    data = simulate(distort=True)
    fit = fit_response(data, "phase-mod-pi")
    assert abs(pull(fit, "alpha_ratio", 10.0)) < 4
    assert abs(pull(fit, "quality_factor", Q)) < 4
    assert 0.8 < fit.chi2_reduced < 1.2
    assert fit_response(data, "complex").chi2_reduced > 10


def test_a_magnitude_sweep_puts_the_fold_where_it_jumped() -> None:
    # Until it jumps, the high state follows the backbone whatever w is: the jump tells w.
    data = simulate(drives=(1.0,), noise=2e-3).isel(sweep=[0])
    fit = fit_response(data, "magnitude")
    frequency = data["frequency"].values[0]
    size = np.hypot(data["real"].values[0], data["imag"].values[0])
    jump = int(np.argmax(-np.diff(size)))
    delta, _ = fold(STIFFEN * fit["alpha_ratio"], top=True)
    found = fit["frequency"] - fit["linewidth"] * delta / 2
    assert (
        frequency[jump] - 0.5 * MODE.linewidth / 8.8
        < found
        < frequency[jump + 1] + 0.5 * MODE.linewidth / 8.8
    )
    assert abs(pull(fit, "quality_factor", Q)) < 4
    assert fit.parameters["quality_factor"].sd < 0.03 * Q


def test_nonlinear_damping_is_told_from_stiffness() -> None:
    eta = 0.4 * ALPHA * Q
    mode = Resonator(F0, Q, alpha=ALPHA, nonlinear_damping=eta)
    data = simulate(mode)
    fit = fit_response(data, nonlinear_damping=True, force_per_volt=FORCE)
    assert abs(pull(fit, "eta", eta)) < 4
    assert abs(pull(fit, "alpha", ALPHA)) < 4
    assert fit.chi2_reduced < 1.2
    assert fit_response(data).chi2_reduced > 10


def test_sweeps_without_a_direction_are_fitted_as_well() -> None:
    data = simulate()
    fit = fit_response(data.drop_vars("direction"))
    known = fit_response(data)
    for name in ("frequency", "linewidth", "alpha_ratio"):
        assert abs(fit[name] - known[name]) < known.parameters[name].sd


def test_a_softening_mode_and_missing_points_are_fitted() -> None:
    mode = Resonator(F0, Q, alpha=-ALPHA)
    data = simulate(mode)
    mirrored = data.assign_coords(frequency=data["frequency"] - 9 * mode.linewidth)
    frequency = mirrored["frequency"].values[0]
    volts = [
        sweep(mode, FORCE * d, frequency[::s])[::s] * GAIN
        for d, s in zip(data["drive"].values, data["direction"].values, strict=True)
    ]
    rng = np.random.default_rng(3)
    noisy = np.array(volts) + 2e-4 * (
        rng.normal(size=data["real"].shape) + 1j * rng.normal(size=data["real"].shape)
    )
    noisy[1, 20:40] = np.nan
    fit = fit_response(
        response(
            frequency,
            noisy,
            drive=data["drive"].values,
            direction=data["direction"].values,
            noise_sd=2e-4,
        )
    )
    assert abs(pull(fit, "alpha_ratio", -10.0)) < 4
    assert "20 missing points left out" in fit.notes


def test_a_predicted_response_meets_the_data_it_was_fitted_to() -> None:
    data = simulate(gain=(GAIN + 0j, GAIN / 3 * 1j))
    fit = fit_response(data)
    rest = data["real"] + 1j * data["imag"] - predict_response(fit, data).values
    chi2 = float(np.sum(np.abs(rest.values / 2e-4) ** 2)) / (2 * rest.size)
    assert chi2 == pytest.approx(1, abs=0.1)
    assert chi2 == pytest.approx(fit.chi2_reduced, abs=0.02)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_leak_of_thirty_times_the_resonance_hides_it_at_no_drive(sign: int) -> None:
    rng = np.random.default_rng(1)
    drives = np.array([0.5, 1.0, 2.0])
    frequency = np.linspace(2.93224e6, 2.93256e6, 161) + np.zeros((3, 1))
    away = frequency - 2.9324003e6
    gain = 0.4 / (1 + 2j * away / 4) + (4.4 + 10.9j) * (1 + 1e-4 * away)
    noise = 2e-3 * (rng.standard_normal(away.shape) + 1j * rng.standard_normal(away.shape))
    volts = drives[:, None] * gain + noise
    data = response(
        frequency,
        volts if sign > 0 else volts.conj(),
        drive=drives,
        direction=[1, 1, 1],
        noise_sd=2e-3,
    )
    fit = fit_response(data, "complex")
    assert fit.chi2_reduced < 1.2
    assert abs(pull(fit, "frequency", 2.9324003e6)) < 4
    assert abs(pull(fit, "linewidth", 4.0)) < 4


def test_bounds_hold_and_name_what_they_limit() -> None:
    data = simulate()
    fit = fit_response(data, bounds={"alpha_ratio": (0.0, 8.0)})
    assert 7.9 < fit["alpha_ratio"] <= 8.0
    free = fit_response(data, bounds={"frequency": (F0 - 1e4, F0 + 1e4)})
    assert free["frequency"] == pytest.approx(
        fit_response(data)["frequency"], abs=1e-3 * MODE.linewidth
    )
    with pytest.raises(
        ParameterError, match=r"bounds\['width'\].*frequency, linewidth, alpha_ratio"
    ):
        fit_response(data, bounds={"width": (0.0, 1.0)})


@pytest.mark.slow
def test_alpha_ratio_does_not_depend_on_the_position_along_a_line() -> None:
    # A line through both modes' antinodes: the signal varies twentyfold and changes sign, α_y four
    # hundredfold; α_y/α_c does not.
    x = np.linspace(-0.47, 0.47, 9)
    for shape in (np.cos(np.pi * x), np.sin(2 * np.pi * x)[x != 0]):
        data = simulate(
            drives=(1.0,), gain=tuple(GAIN * shape.astype(complex)), noise=2e-4, points=121
        )
        scan = fit_line_scan(data)
        assert scan.sizes["position"] == len(shape)
        np.testing.assert_allclose(
            scan["y_max"] * np.max(np.abs(shape)) / scan["y_max"].max(), np.abs(shape), rtol=0.05
        )
        assert float(scan["alpha_y"].max() / scan["alpha_y"].min()) > 9
        assert scan.attrs["scatter"] < 2.5
        assert abs(scan.attrs["alpha_ratio"] - 10) < 4 * scan.attrs["alpha_ratio_sd"]
        together = fit_response(data)
        assert (
            abs(together["alpha_ratio"] - scan.attrs["alpha_ratio"]) < scan.attrs["alpha_ratio_sd"]
        )


def test_a_line_scan_quotes_all_positions_at_one_drive() -> None:
    data = simulate(drives=(0.5, 1.0), gain=(GAIN + 0j, GAIN / 2 + 0j))
    uneven = data.isel(sweep=(data["x"].values == 0) | (data["drive"].values < 1))
    scan = fit_line_scan(uneven)
    assert scan.attrs["drive"] == 1
    np.testing.assert_allclose(scan["alpha_ratio"], 10, rtol=0.02)
    assert scan.attrs["scatter"] < 10


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "map"}, "kind = 'map'"),
        ({"drive": [0.0, 0.1, 0.1, 1, 1, 1]}, "drive = 0 V"),
        ({"harmonic": [2] * 6}, "none is the first"),
    ],
)
def test_data_that_cannot_be_fitted_are_refused_in_one_line(
    change: dict[str, Any], message: str
) -> None:
    data = simulate()
    for name, value in change.items():
        data = (
            data.assign_attrs(kind=value)
            if name == "kind"
            else data.assign_coords({name: ("sweep", value)})
        )
    with pytest.raises(MeasurementError, match=message):
        fit_response(data)


def test_derivatives_of_every_residual_match_differences() -> None:
    data = simulate(
        Resonator(F0, Q, alpha=ALPHA, nonlinear_damping=0.1 * ALPHA * Q),
        gain=(GAIN + 0j, GAIN / 3 * 1j),
        noise=3e-3,
        delay=2e-5,
    )
    sweeps = collect(data)
    for use in ("complex", "magnitude", "phase", "phase-mod-pi"):
        for damping in (False, True):
            layout = Layout(
                F0,
                MODE.linewidth,
                sweeps.span,
                sweeps.reference,
                2,
                damping,
                not use.startswith("phase"),
                use != "magnitude",
            )
            theta = np.zeros(layout.size)
            theta[2] = 9.7
            if damping:
                theta[3] = 0.5
            theta[layout.gains] = np.log([0.033, 0.011])[: layout.gains.stop - layout.gains.start]
            misfit = Misfit.of(sweeps, layout, use)
            misfit.assign(theta)
            slopes = misfit.jacobian(theta)
            for k in range(layout.size):
                step = np.zeros(layout.size)
                step[k] = 1e-6
                numeric = (misfit.residual(theta + step) - misfit.residual(theta - step)) / 2e-6
                error = np.abs(numeric - slopes[:, k]) / (
                    np.abs(slopes[:, k]) + 1e-4 * np.abs(slopes[:, k]).max()
                )
                # All but the few points next to a fold, where the derivative is limited on purpose,
                # or at a turn of the phase.
                assert np.quantile(error, 0.98) < 1e-4, (use, k)


@pytest.mark.parametrize("a", [1.55, 3.0, -12.0, 90.0])
@pytest.mark.parametrize("top", [True, False])
def test_folds_lie_where_the_number_of_states_changes(a: float, top: bool) -> None:
    delta, x = fold(a, top=top)
    counts = [int(np.isfinite(duffing_roots(delta + step, a)).sum()) for step in (-1e-6, 1e-6)]
    assert sorted(counts) == [1, 3]
    step = 1e-5
    assert (fold(a + step, top=top)[0] - fold(a - step, top=top)[0]) / (2 * step) == pytest.approx(
        -x, rel=1e-6
    )


@pytest.mark.parametrize("size", [0.0, 0.7, 3.0, 50.0, 200.0])
def test_rice_moments_match_a_simulation(size: float) -> None:
    rng = np.random.default_rng(5)
    draws = np.abs(size + rng.normal(size=400_000) + 1j * rng.normal(size=400_000))
    mean, sd, growth = rice(np.array([size]))
    assert mean[0] == pytest.approx(draws.mean(), abs=5 * draws.std() / np.sqrt(draws.size))
    assert sd[0] == pytest.approx(draws.std(), rel=0.01)
    assert growth[0] == pytest.approx(
        ((rice(np.array([size + 1e-5]))[0] - mean) / 1e-5)[0], abs=1e-4
    )


def coverage(use: Use, draws: int, noise: float, drives: tuple[float, ...]) -> Array:
    """Fraction of draws whose 68 % interval holds the truth, for f₀, w and α_y/α_c."""
    truth = {"frequency": F0, "linewidth": F0 / Q, "alpha_ratio": 10 * max(drives) ** 2}
    inside = []
    for seed in range(draws):
        fit = fit_response(simulate(drives=drives, noise=noise, seed=seed, points=101), use)
        inside.append([abs(pull(fit, name, value)) < 1 for name, value in truth.items()])
    return np.asarray(np.mean(inside, axis=0))


CASES: list[tuple[Use, float, tuple[float, ...]]] = [
    ("complex", 1e-3, (0.1, 1.0)),
    ("complex", 1.2e-3, (0.15,)),
    ("magnitude", 1e-3, (0.1, 1.0)),
    ("phase-mod-pi", 1e-3, (0.1, 1.0)),
]


@pytest.mark.parametrize(("use", "noise", "drives"), CASES[-1:])  # the slow study has them all
def test_intervals_hold_the_truth_about_two_times_in_three(
    use: Use, noise: float, drives: tuple[float, ...]
) -> None:
    # 40 draws: 0.68 ± 0.22 is three standard deviations.
    np.testing.assert_allclose(coverage(use, 40, noise, drives), 0.683, atol=0.22)


@pytest.mark.slow
@pytest.mark.parametrize(("use", "noise", "drives"), CASES)
def test_intervals_hold_the_truth_in_68_percent_of_1000_draws(
    use: Use, noise: float, drives: tuple[float, ...]
) -> None:
    # 1000 draws: 0.04 is 2.7 standard deviations; twelve rates are looked at.
    np.testing.assert_allclose(coverage(use, 1000, noise, drives), 0.683, atol=0.04)


def test_the_linear_peak_of_a_fit_is_where_alpha_c_counts_from() -> None:
    assert pytest.approx(8 * np.sqrt(3) / 9) == STIFFEN
