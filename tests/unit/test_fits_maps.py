"""Map fits on maps made by the readout stage.

What they find, what they say they cannot find, and how honest their intervals are.
"""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from femnl.core.device import Layer, Stack
from femnl.core.errors import MeasurementError, ParameterError
from femnl.core.fit import MapFit
from femnl.core.readout import Array, PeriodicFringe
from femnl.fits.map.fit import fit_map
from femnl.io.measurement import harmonic_map, read
from femnl.observe.map.forward import Shape, flatten, predict, slopes
from femnl.optics.fringe import MultilayerFringe, SineFringe
from femnl.optics.harmonics import harmonics

RED = 632.8e-9
GREEN = 532e-9
SIDE = 270e-6
DATA = Path(__file__).parents[3] / "shared" / "data"
STACK = Stack(
    (
        Layer("vacuum", np.inf, ((RED, 1 + 0j), (GREEN, 1 + 0j))),
        Layer("SiN", 183.75e-9, ((RED, 2.0395 + 0j), (GREEN, 2.0559 + 0j))),
        Layer("vacuum", 3226.25e-9, ((RED, 1 + 0j), (GREEN, 1 + 0j))),
        Layer("Si", np.inf, ((RED, 3.8640 - 0.0158j), (GREEN, 4.1366 - 0.0338j))),
    ),
    gap=2,
)


def square(m: int = 1, n: int = 1) -> Shape:
    """The shape (m,n) of an ideal square membrane."""

    def shape(x: Array, y: Array) -> Array:
        inside = (np.abs(x) < SIDE / 2) & (np.abs(y) < SIDE / 2)
        return np.where(
            inside, np.sin(m * np.pi * (x / SIDE + 0.5)) * np.sin(n * np.pi * (y / SIDE + 0.5)), 0.0
        )

    return shape


PLACED = {"x": 6e-6, "y": -9e-6, "scale": 1.03, "rotation": 0.05}
CENTRED = {"x": 0.0, "y": 0.0, "scale": 1.0, "rotation": 0.0}
SIX = (1, 2, 3, 4, 5, 6)


def measured(
    fringe: PeriodicFringe,
    amplitude: float,
    seed: int,
    shape: Shape,
    *,
    n_points: int = 31,
    noise: float = 3e-4,
    phase: float = 0.4,
    harmonic: tuple[int, ...] = SIX,
    wavelength: float = RED,
    placed: Mapping[str, float] = PLACED,
) -> xr.Dataset:
    """A noisy map of a membrane that lies askew."""
    rng = np.random.default_rng(seed)
    axis = np.linspace(-165e-6, 165e-6, n_points)
    dx, dy = np.meshgrid(axis - placed["x"], axis - placed["y"])
    c = np.cos(placed["rotation"])
    s = np.sin(placed["rotation"])
    xi = shape((c * dx + s * dy) / placed["scale"], (c * dy - s * dx) / placed["scale"])
    values = harmonics(fringe, harmonic, amplitude * xi, phase)
    values = values + noise * (rng.normal(size=values.shape) + 1j * rng.normal(size=values.shape))
    return harmonic_map(axis, axis, harmonic, values, noise_sd=noise, wavelength=wavelength)


def sine(theta: float = 0.6, wavelength: float = RED) -> SineFringe:
    return SineFringe(wavelength, 0.1, 0.02, theta)


def deviations(found: MapFit, truth: Mapping[str, float]) -> Array:
    """Differences from the truth in standard deviations."""
    return np.array(
        [(found.fit[name] - value) / found.fit.parameters[name].sd for name, value in truth.items()]
    )


TRUTH = {"contrast": 0.02, "fringe_phase": 0.6, "motion_phase": 0.4, **PLACED}


@pytest.mark.parametrize("z", [0.8, 2.0, 4.218, 8.85, 14.0])
def test_fit_finds_motion_fringe_and_placement_without_start_values(z: float) -> None:
    U = z * RED / 4 / np.pi
    found = fit_map(measured(sine(), U, int(10 * z), square()), square())
    assert np.abs(deviations(found, {"amplitude": U, **TRUTH})).max() < 4
    assert found.fit.chi2_reduced == pytest.approx(1, abs=4 * np.sqrt(2 / found.fit.n_points))
    assert found.fit["modulation"] == pytest.approx(4 * np.pi * found.fit["amplitude"] / RED)


def test_residual_and_prediction_make_up_the_data() -> None:
    data = measured(sine(), 3e-7, 1, square())
    found = fit_map(data, square())
    assert found.prediction[""] + 3e-4 * found.residual[""] == pytest.approx(
        data["real"].values + 1j * data["imag"].values, abs=1e-16
    )
    assert np.std(found.residual[""].real) == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize("fringe", [sine(), MultilayerFringe(STACK, RED)])
def test_model_of_the_fit_is_that_of_the_readout(fringe: PeriodicFringe) -> None:
    data = flatten("", measured(fringe, 4e-7, 0, square(2, 1)), fringe)
    values = {
        "amplitude": 4.1e-7,
        "contrast": 0.02,
        "fringe_phase": 0.3,
        "motion_phase": 0.2,
        **CENTRED,
    }
    expected = harmonics(
        data.series, SIX, 4.1e-7 * square(2, 1)(data.x, data.y), 0.2, 0.3 / data.wavenumber
    )
    assert np.abs(predict(data, square(2, 1), values) - 0.02 * expected).max() < 0.02 * 2e-7


@pytest.mark.parametrize("fringe", [sine(), MultilayerFringe(STACK, RED)])
def test_derivatives_of_the_model_agree_with_differences(fringe: PeriodicFringe) -> None:
    def smooth(x: Array, y: Array) -> Array:
        return np.exp(-((x / 9e-5) ** 2) - (y / 7e-5) ** 2 + x * y / 2e-8)

    data = flatten("", measured(fringe, 4e-7, 0, smooth), fringe)
    values = {
        "amplitude": 4e-7,
        "contrast": 0.02,
        "fringe_phase": 0.6,
        "motion_phase": 0.4,
        **PLACED,
    }
    values |= {
        "overtone_2_real": 0.1,
        "overtone_2_imag": -0.05,
        "overtone_3_real": 0.02,
        "overtone_3_imag": 0.03,
    }
    by = slopes(data, smooth, values)
    assert set(by) == set(values)
    for name in values:
        step = 1e-4 * {"x": 1e-4, "y": 1e-4}.get(name, values[name])
        ends = [
            predict(data, smooth, {**values, name: values[name] + sign * step}) for sign in (1, -1)
        ]
        difference = (ends[0] - ends[1]) / (2 * step)
        assert np.abs(by[name] - difference).max() < 2e-5 * np.abs(difference).max(), name


def test_missing_points_are_left_out() -> None:
    whole = measured(sine(), 3e-7, 5, square())
    holed = whole.copy(deep=True)
    rng = np.random.default_rng(0)
    for part in ("real", "imag"):
        holed[part].values[rng.random(holed[part].shape) < 0.15] = np.nan
        holed[part].values[:, 3, :] = np.nan
    found = fit_map(holed, square())
    assert np.abs(deviations(found, {"amplitude": 3e-7, **TRUTH})).max() < 4
    kept = np.isfinite(holed["real"].values) & np.isfinite(holed["imag"].values)
    assert found.fit.n_points == 2 * kept.sum()
    assert np.array_equal(np.isfinite(found.residual[""]), kept)


def test_red_and_green_maps_share_one_amplitude() -> None:
    maps = {
        "red": measured(sine(0.6), 4.45e-7, 1, square()),
        "green": measured(sine(1.9, GREEN), 4.45e-7, 2, square(), wavelength=GREEN, phase=-1.0),
    }
    found = fit_map(maps, square())
    alone = fit_map(maps["red"], square())
    truth = {
        "amplitude": 4.45e-7,
        "fringe_phase:red": 0.6,
        "fringe_phase:green": 1.9,
        "motion_phase:green": -1.0,
        "x:green": 6e-6,
    }
    assert np.abs(deviations(found, truth)).max() < 4
    assert found.fit.parameters["amplitude"].sd < 0.8 * alone.fit.parameters["amplitude"].sd
    assert found.fit["modulation:green"] / found.fit["modulation:red"] == pytest.approx(RED / GREEN)


def test_different_amplitudes_of_red_and_green_are_seen_in_the_misfit() -> None:
    maps = {
        "red": measured(sine(0.6), 4.45e-7, 1, square()),
        "green": measured(sine(1.9, GREEN), 4.60e-7, 2, square(), wavelength=GREEN),
    }
    assert fit_map(maps, square()).fit.chi2_reduced > 1.2


def test_multilayer_fringe_gives_the_shift_of_the_gap() -> None:
    shift = 21e-9
    moved = Stack(
        tuple(
            Layer(one.material, one.thickness + shift * (i == 2), one.index)
            for i, one in enumerate(STACK.layers)
        ),
        2,
    )
    data = measured(MultilayerFringe(moved, RED, gain=0.05), 4e-7, 3, square())
    found = fit_map(data, square(), MultilayerFringe(STACK, RED))
    assert abs(found.fit["amplitude"] - 4e-7) < 4 * found.fit.parameters["amplitude"].sd
    assert abs(found.fit["working_point"] - shift) < 4 * found.fit.parameters["working_point"].sd
    assert fit_map(data, square()).fit.chi2_reduced > 3


def test_form_of_the_fringe_is_found_together_with_the_motion() -> None:
    fringe = MultilayerFringe(STACK, RED, gain=0.05)
    found = fit_map(measured(fringe, 4e-7, 3, square()), square(), free_overtones=5)
    c = fringe.fourier.coefficients
    unit = c / abs(c[1]) * np.exp(-1j * np.arange(len(c)) * np.angle(c[1]))
    truth = {
        "amplitude": 4e-7,
        **{
            f"overtone_{k}_{part}": getattr(unit[k], part)
            for k in (2, 3)
            for part in ("real", "imag")
        },
        **PLACED,
    }
    assert np.abs(deviations(found, truth)).max() < 4
    assert found.fit["overtone_2_real"] == pytest.approx(-0.23, abs=0.01)


def test_mode_with_a_node_is_fitted_too() -> None:
    found = fit_map(measured(sine(), 2.5e-7, 8, square(2, 1), placed=PLACED), square(2, 1))
    assert (
        np.abs(
            deviations(found, {"amplitude": 2.5e-7, "fringe_phase": 0.6, "rotation": 0.05})
        ).max()
        < 4
    )


def test_sign_of_the_working_point_is_said_to_be_open_and_its_quadrant_to_be_known() -> None:
    notes = " | ".join(fit_map(measured(sine(), 3e-7, 4, square()), square()).fit.notes)
    assert "θ is indistinguishable from −θ" in notes
    assert "θ is preferred to π − θ" in notes


def test_odd_harmonics_alone_leave_contrast_and_working_point_undetermined() -> None:
    found = fit_map(measured(sine(), 3e-7, 4, square(), harmonic=(1, 3, 5)), square())
    assert found.fit.parameters["contrast"].sd == np.inf
    assert found.fit.parameters["fringe_phase"].sd == np.inf
    assert any(
        "do not determine contrast and fringe_phase apart" in note for note in found.fit.notes
    )
    assert abs(found.fit["amplitude"] - 3e-7) < 4 * found.fit.parameters["amplitude"].sd


def test_rotation_of_a_round_shape_is_said_to_be_undetermined() -> None:
    def bell(x: Array, y: Array) -> Array:
        return np.exp(-(x**2 + y**2) / (9e-5) ** 2)

    found = fit_map(measured(sine(), 3e-7, 4, bell), bell)
    assert found.fit.parameters["rotation"].sd == np.inf
    assert np.isfinite(found.fit.parameters["amplitude"].sd)


def test_a_single_spot_gives_its_amplitude() -> None:
    values = harmonics(sine(), SIX, 3e-7, 0.4)[:, None, None]
    data = harmonic_map([0.0], [0.0], SIX, values, noise_sd=1e-6, wavelength=RED)
    found = fit_map(data, lambda x, y: np.ones(np.broadcast(x, y).shape), registration=())
    assert found.fit["amplitude"] == pytest.approx(3e-7, rel=1e-9)


def test_noise_is_estimated_where_the_file_does_not_say() -> None:
    data = measured(sine(), 3e-7, 6, square(), n_points=51)
    known = fit_map(data, square())
    del data.attrs["noise_sd"]
    found = fit_map(data, square())
    assert found.fit.parameters["amplitude"].sd == pytest.approx(
        known.fit.parameters["amplitude"].sd, rel=0.05
    )
    assert any("noise_sd is not in the file" in note for note in found.fit.notes)


def coverage(n_draws: int) -> Array:
    """Return deviations from the truth in standard deviations, (n_draws, n_parameters)."""
    truth = {"amplitude": 3e-7, **TRUTH}
    draws = (
        fit_map(measured(sine(), 3e-7, 1000 + i, square(), n_points=21, noise=1e-3), square())
        for i in range(n_draws)
    )
    return np.array([deviations(found, truth) for found in draws])


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_they_say_on_a_few_draws() -> None:
    z = coverage(14)
    assert np.mean(np.abs(z) < 1) == pytest.approx(0.6827, abs=0.14)
    assert np.mean(z**2) == pytest.approx(1, abs=0.4)


@pytest.mark.slow
def test_intervals_of_every_parameter_hold_the_truth_in_68_percent_of_400_draws() -> None:
    held = np.mean(np.abs(coverage(400)) < 1, axis=0)
    # Three binomial σ for each of eight parameters
    assert held == pytest.approx(np.full(held.size, 0.68), abs=0.07)
    assert held.mean() == pytest.approx(0.68, abs=0.04)


def failures(seeds: range) -> list[int]:
    """Return seeds of random maps whose fit misses the truth.

    Depth, working point, placement, noise and mode are drawn.
    """
    missed = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        U = rng.uniform(1, 20) * RED / 4 / np.pi
        placed = {
            "x": rng.uniform(-15e-6, 15e-6),
            "y": rng.uniform(-15e-6, 15e-6),
            "scale": rng.uniform(0.92, 1.08),
            "rotation": rng.uniform(-0.12, 0.12),
        }
        shape = square(*[(1, 1), (2, 1), (2, 2)][rng.integers(3)])
        fringe = sine(rng.uniform(0.1, np.pi - 0.1))
        noise = 0.02 * 10 ** rng.uniform(-2.3, -1)
        phase = rng.uniform(-3, 3)
        found = fit_map(
            measured(fringe, U, seed, shape, noise=noise, phase=phase, placed=placed), shape
        ).fit
        if (
            abs(found["amplitude"] - U) > 5 * found.parameters["amplitude"].sd
            or found.chi2_reduced > 1.2
        ):
            missed.append(seed)
    return missed


@pytest.mark.slow
def test_random_maps_are_all_met() -> None:
    assert failures(range(7000, 7010)) == []


@pytest.mark.slow
def test_hundreds_of_random_maps_are_all_met() -> None:
    assert failures(range(8000, 8300)) == []


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data.assign_coords(harmonic=np.arange(6)), "harmonic 0 cannot be fitted"),
        (lambda data: data * np.nan, "no point has a value"),
        (lambda data: data.assign_attrs(wavelength=None), "without the attribute wavelength"),
    ],
)
def test_unusable_maps_are_refused_in_one_line(
    change: Callable[[xr.Dataset], xr.Dataset], message: str
) -> None:
    with xr.set_options(keep_attrs=True):
        data = change(measured(sine(), 3e-7, 0, square()))
    if data.attrs.get("wavelength") is None:
        del data.attrs["wavelength"]
    with pytest.raises(MeasurementError, match=message):
        fit_map(data, square())


def test_unknown_placement_is_refused() -> None:
    with pytest.raises(ParameterError, match="choose from x, y, scale, rotation"):
        fit_map(measured(sine(), 3e-7, 0, square()), square(), registration=("angle",))


def test_fringes_must_be_named_like_the_maps() -> None:
    with pytest.raises(ParameterError, match="name each map once"):
        fit_map({"red": measured(sine(), 3e-7, 0, square())}, square(), {"green": sine()})


@pytest.mark.shared
@pytest.mark.skipif(not DATA.exists(), reason="../shared/data is not there")
def test_shared_null_map_gives_its_amplitude_and_working_point() -> None:
    found = fit_map(read(DATA / "open-map-null.nc")["map"].to_dataset(), square())
    assert (
        np.abs(
            deviations(
                found, {"amplitude": 3.1341581347821576e-07, "fringe_phase": 0.6016547564153172}
            )
        ).max()
        < 3
    )
    assert found.fit.chi2_reduced == pytest.approx(1, abs=3 * np.sqrt(2 / found.fit.n_points))


@pytest.mark.shared
@pytest.mark.skipif(not DATA.exists(), reason="../shared/data is not there")
def test_shared_multilayer_map_needs_the_stack_and_gives_its_gap() -> None:
    data = read(DATA / "open-map-multilayer.nc")["map"].to_dataset()
    fringe = MultilayerFringe(STACK, RED)
    found = fit_map(data, square(), fringe)
    assert (
        abs(3226.25e-9 + found.fit["working_point"] - 3.2287439231226333e-06)
        < 3 * found.fit.parameters["working_point"].sd
    )
    assert (
        abs(found.fit["amplitude"] - 3.9696633704590547e-07)
        < 3 * found.fit.parameters["amplitude"].sd
    )
    assert found.fit.chi2_reduced < 1.02 < 10 < fit_map(data, square()).fit.chi2_reduced


def test_a_map_of_one_pixel_is_refused_with_the_parameters_that_it_cannot_tell() -> None:
    axis = np.linspace(-5e-5, 5e-5, 11)
    values = np.full((2, 11, 11), np.nan + 0j)
    values[:, 5, 5] = 1.0
    data = harmonic_map(axis, axis, [1, 2], values, noise_sd=1e-3, wavelength=633e-9)
    with pytest.raises(MeasurementError, match=r"numbers that are no gaps, for \d parameters"):
        fit_map(data, square(1, 1))
