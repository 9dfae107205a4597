"""Sweeps with a second mode near by, and sweeps that soften, stepped in time by the slow flow."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from femnl import load
from femnl.core.compiled import compiled
from femnl.core.diagnosis import Diagnosis
from femnl.core.errors import MeasurementError
from femnl.diagnose import diagnose
from femnl.diagnose.criticism import criticise
from femnl.diagnose.search import search
from femnl.diagnose.thresholds import THRESHOLDS
from femnl.effects import library
from femnl.fits.least_squares import fit
from femnl.fits.response.choice import first_look, turned
from femnl.fits.response.fit import first_layout
from femnl.fits.response.pose import pose as pose_response
from femnl.fits.response.start import likely_sign
from femnl.io import measurement
from femnl.observe.extended import ExtendedModel
from femnl.observe.film import SimulatedFilm
from femnl.observe.response.states import follow
from femnl.observe.response.sweeps import collect
from tests.blind.lab import Case, make
from tests.blind.realistic.files import Draw
from tests.blind.realistic.files import make as make_realistic

Complex = NDArray[np.complex128]
F0 = 2.9324e6
WIDTH = 4.0
PEAK = 1.75e-7
PER_METRE = 2e5
NOISE = 1.5e-5
SETTLED = 1e-8
"""Relative change in a step of time at which a state counts as steady."""


def sweeps(path: Path, alpha: float, coupling: float) -> Diagnosis:
    """Diagnose up and down sweeps.

    a second mode crosses 6 Hz above resonance, coupling [Hz²] at one linewidth of stiffening.
    """
    rng = np.random.default_rng(1)
    drives = np.repeat([0.05, 0.1, 0.2, 0.4], 2)
    direction = np.tile([1, -1], 4)
    bend = 0.375 * F0 * alpha * (PEAK * drives.max()) ** 2
    frequency = np.linspace(
        F0 - 10 * WIDTH + min(0.8 * bend, 0), F0 + 8 * WIDTH + max(0.8 * bend, 0), 161
    )
    square = 8 * WIDTH / (3 * F0 * abs(alpha))
    state = np.zeros(8, complex)
    volts = np.empty((8, len(frequency)), complex)
    for k in range(len(frequency)):
        point = np.where(direction > 0, k, len(frequency) - 1 - k)
        f = frequency[point]
        cubic = np.asarray(
            0.375 * F0 * alpha - coupling / square / (F0 + 6 - f + 0.75j), np.complex128
        )

        def rate(a: Complex, f: NDArray[np.float64] = f, cubic: Complex = cubic) -> Complex:
            pull = 2 * (F0 + cubic * np.abs(a) ** 2 - f) / WIDTH
            return np.asarray(-1j * (PEAK * drives - a * (pull + 1j)))

        for _ in range(20_000):  # just past a fold a state lingers
            h = 0.03
            one = rate(state)
            two = rate(state + h / 2 * one)
            three = rate(state + h / 2 * two)
            step = h / 6 * (one + 2 * two + 2 * three + rate(state + h * three))
            state = state + step
            if np.abs(step).max() < SETTLED * np.abs(state).max():
                break
        volts[np.arange(8), point] = state
    signal = PER_METRE * volts * np.exp(0.4j)
    signal = signal + NOISE * (
        rng.standard_normal(signal.shape) + 1j * rng.standard_normal(signal.shape)
    )
    data = measurement.response(
        frequency,
        signal,
        noise_sd=NOISE,
        wavelength=632.8e-9,
        mode="2,2",
        drive=drives,
        direction=direction,
    )
    measurement.write(measurement.bundle({"sweeps": data}, geometry="square-270um"), path)
    return diagnose(path)


@pytest.mark.slow
def test_a_wiggle_at_fixed_frequency_is_an_internal_resonance_with_its_place_width_and_order(
    tmp_path: Path,
) -> None:
    found = sweeps(tmp_path / "response.nc", 2.3e10, 6.0)
    assert (found.verdict, found.causes) == ("explained", ("internal_resonance",)), (
        found.where,
        found.alternatives,
    )
    for name, truth in (("coupling_square", 6.0), ("width", 1.5), ("order", 2.0)):
        size = found.parameters["internal_resonance"][name]
        assert abs(size.value - truth) < 4 * size.sd + 1e-3 * truth, size


@pytest.mark.slow
def test_sweeps_that_soften_show_a_quadratic_force(tmp_path: Path) -> None:
    found = sweeps(tmp_path / "response.nc", -1.2e10, 0.0)
    assert (found.verdict, found.causes) == ("explained", ("quadratic_stiffness",)), (
        found.where,
        found.alternatives,
    )
    kappa = found.parameters["quadratic_stiffness"]["kappa2"]
    # (10/9) κ₂² must make up for the film's own α and for the negative one that is seen, which sets
    # the metres.
    assert 10 / 9 * kappa.value**2 == pytest.approx(2 * 2.75e10, rel=0.01)


def test_a_second_mode_is_sought_where_the_drives_move_the_film_strongly() -> None:
    frequency = F0 + np.linspace(-60, 60, 241)
    volts = PER_METRE * PEAK * 0.01 / (1 + 2j * (frequency - F0) / WIDTH)
    data = measurement.response(
        frequency,
        volts[None],
        noise_sd=1e-9,
        wavelength=632.8e-9,
        mode="2,2",
        drive=[0.01],
        direction=[1],
    )
    base_model = pose_response(data, SimulatedFilm(load("square-270um"), 12))
    # |1/(1 + 2iδ/w)| = 0.3 at δ = ½w √(0.3⁻² − 1).
    assert base_model.scales["moving"] == pytest.approx(WIDTH * np.sqrt(0.3**-2 - 1), abs=1.0)
    base = dict(zip((spec.name for spec in base_model.base), base_model.start, strict=True))
    couple = {"coupling_square": 0.5, "offset": 0.0, "width": 0.8, "order": 2.0}
    mode, _ = base_model._mode([library()["internal_resonance"]], base, [couple], base_model.sweeps)
    assert base_model.sweeps.frequency[np.argmax(np.abs(mode.pull))] == pytest.approx(F0, abs=0.6)


@pytest.mark.parametrize(
    ("causes", "size", "seen"),
    [
        ((), 0, ""),
        (("crosstalk",), 12, "background at"),
        (("frequency_drift",), 8, "frequency of sweep"),
    ],
)
def test_what_one_drive_or_sweep_has_of_its_own_is_seen_without_a_cause_to_look_for(
    causes: tuple[str, ...], size: float, seen: str, tmp_path: Path
) -> None:
    path = tmp_path / "response.nc"
    make(Case("response", causes, 20261122, size=(size, size + 0.1)), path)
    (group,) = measurement.read(path).children.values()
    base_model = pose_response(group.to_dataset(), SimulatedFilm(load("square-270um"), 12))
    found = criticise(fit(ExtendedModel(base_model), base_model.start), [])
    assert (found.p_value < THRESHOLDS.base_inadequate) == bool(causes), (
        found.p_value,
        found.worst,
    )
    assert abs(found.result.chi2 / found.result.degrees - 1) < 0.15  # χ² alone would hardly tell
    assert not causes or seen in found.worst


def test_a_fit_is_led_over_jumps_that_a_thousandth_of_the_peak_moves(tmp_path: Path) -> None:
    make(Case("response", ("drive_compression",), 2317476753), tmp_path / "file.nc")
    data = measurement.read(tmp_path / "file.nc")["response"].to_dataset()
    base_model = pose_response(data, SimulatedFilm(load("square-270um"), 12))
    found = [
        candidate.result
        for candidate in search(base_model, [library()["drive_compression"]])
        if candidate.names
    ]
    # Steps of three thousandths of the peak and more end at 1.22.
    assert found[0].chi2 / found[0].degrees < 1.1


@pytest.mark.parametrize(
    "causes",
    [
        (),
        *(pytest.param((c,), marks=pytest.mark.slow) for c in ("crosstalk", "quintic_stiffness")),
    ],
)
def test_a_phase_that_rises_with_frequency_is_noticed_and_told(
    causes: tuple[str, ...], tmp_path: Path
) -> None:
    make(Case("response", causes, 20331125), tmp_path / "file.nc")
    data = measurement.read(tmp_path / "file.nc")["response"].to_dataset()
    turned = data.assign(imag=-data["imag"])
    film = SimulatedFilm(load("square-270um"), 12)
    (falling, rising) = (pose_response(one, film) for one in (data, turned))
    at_start = ExtendedModel(falling).residuals(falling.start)
    assert ExtendedModel(rising).residuals(rising.start) == pytest.approx(at_start)
    assert not any("conjugated" in note for note in falling.notes)
    assert any("conjugated" in note for note in rising.notes)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_leak_that_grows_with_the_drive_does_not_turn_the_sign_of_the_phase(
    sign: int, tmp_path: Path
) -> None:
    """No model without the leak meets the data, and their linear form has the wrong sign."""
    draw = Draw("response", ("crosstalk",), "exact", "square-270um", 1611926327)
    make_realistic(draw, tmp_path / "file.nc")
    data = collect(measurement.read(tmp_path / "file.nc")["response"].to_dataset())
    assert likely_sign(data) < 0
    look = first_look(turned(data, sign), first_layout(data, "complex"))
    assert look.phase_sign == sign
    assert look.on_circle


@pytest.mark.slow
def test_a_drift_of_many_linewidths_does_not_turn_the_sign_of_the_phase(tmp_path: Path) -> None:
    """By 13 linewidths: to one linear form at each place all sweeps circle the other way."""
    draw = Draw("response", ("frequency_drift",), "correlated noise", "square-270um", 3909290084)
    make_realistic(draw, tmp_path / "file.nc")
    data = collect(measurement.read(tmp_path / "file.nc")["response"].to_dataset())
    assert likely_sign(data) > 0
    assert likely_sign(turned(data, -1)) < 0


@pytest.mark.slow
def test_a_leak_of_thirty_times_the_resonance_does_not_hide_the_mode(tmp_path: Path) -> None:
    make(Case("response", (), 3), tmp_path / "file.nc")
    data = measurement.read(tmp_path / "file.nc")["response"].to_dataset()
    alone = pose_response(data, SimulatedFilm(load("square-270um"), 12))
    frequency, *_ = alone.start
    away = (data["frequency"] - frequency) / np.ptp(data["frequency"].values)
    leak = 30 * alone.scales["slope"] * data["drive"] * (1 + 0.05 * away)
    leaking = data.assign(real=data["real"] + 0.4 * leak, imag=data["imag"] + 0.9 * leak)
    measurement.write(
        measurement.bundle({"sweeps": leaking}, geometry="square-270um"), tmp_path / "leak.nc"
    )
    found = diagnose(
        tmp_path / "leak.nc", effects=[library()["crosstalk"], library()["sloping_background"]]
    )
    assert (found.verdict, found.causes) == ("explained", ("sloping_background",))
    told = found.parameters["base"]["frequency"]
    assert abs(told.value - frequency) < 4 * told.sd < 0.2


@pytest.mark.slow
def test_a_leak_that_distorts_the_fit_of_the_resonance_is_named(tmp_path: Path) -> None:
    """The mode fitted without the leak is 3.5 times too low, 16 times too broad."""
    truth = make_realistic(
        Draw("response", ("crosstalk",), "exact", "square-270um", 4151124783), tmp_path / "file.nc"
    )
    data = measurement.read(tmp_path / "file.nc")["response"].to_dataset()
    film = SimulatedFilm(load("square-270um"), 12)
    bound = pose_response(data, film).scales["slope"]
    leak = truth["causes"]["crosstalk"]
    seen = np.hypot(data["real"], data["imag"]) / data["drive"]
    assert np.hypot(leak["real"], leak["imag"]) < bound < seen.max()
    # Three neighbours that are off together are no spike, and no leak either
    off = data.copy(deep=True)
    off["real"][-1, 40:43] = 4 * float(data["real"][-1].max())
    assert pose_response(off, film).scales["slope"] == pytest.approx(bound, rel=0.05)
    found = diagnose(tmp_path / "file.nc")
    assert (found.verdict, found.causes) == ("explained", ("crosstalk",))


def test_magnitudes_alone_are_refused_with_what_takes_them(tmp_path: Path) -> None:
    make(Case("response", (), 1), tmp_path / "file.nc")
    data = measurement.read(tmp_path / "file.nc")["response"].to_dataset()
    alone = measurement.magnitudes_alone(data)
    with pytest.raises(MeasurementError, match=r"magnitudes alone.*femnl fit"):
        pose_response(alone, SimulatedFilm(load("square-270um"), 12))


def test_a_sweep_that_no_number_describes_is_on_a_branch_all_the_same() -> None:
    chosen = np.full(6, 99)
    nowhere = np.full(6, np.nan, complex)
    spans = np.array([(0, 3, 1), (3, 6, 0)])
    starts = np.array([(0, 1), (0, 1)])
    compiled(follow)(chosen, nowhere, np.stack([nowhere, nowhere]), spans, starts)
    assert set(chosen) <= {0, 1}
