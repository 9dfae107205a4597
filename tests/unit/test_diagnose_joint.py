"""Files with several measurements.

What they share, what the join buys, and what two wavelengths decide.
"""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray

from femnl.core.effect import Effect
from femnl.device.geometry import load
from femnl.diagnose import diagnose
from femnl.diagnose.joint import JointModel
from femnl.diagnose.pose_joint import pose_joint
from femnl.diagnose.posing import pose
from femnl.effects import library
from femnl.fits.least_squares import fit
from femnl.io import measurement
from femnl.observe.extended import ExtendedModel
from femnl.observe.film import SimulatedFilm
from femnl.optics.fringe import MultilayerFringe
from tests.blind.lab.record import RecordBench
from tests.blind.lab.response import ResponseBench
from tests.unit.decay_records import TONE, record

Array = NDArray[np.float64]
MODEL = load("square-270um")
LASERS = {"red": 632.8e-9, "green": 532e-9}
AMPLITUDE = 4e-7
NOISE = 3e-4
CONTRAST = 0.02
FEW = [
    "mechanical_overtones",
    "multilayer_fringe",
    "detector_saturation",
    "static_bow",
    "quadratic_stiffness",
]


@cache
def film() -> SimulatedFilm:
    """The film that all maps show."""
    return SimulatedFilm(MODEL, 12)


def maps(
    path: Path,
    *,
    overtone: float = 0.0,
    stack: bool = False,
    lasers: dict[str, float] = LASERS,
    points: int = 17,
) -> Path:
    """Write maps of the fundamental mode, sampled over a period.

    Each laser has its own phases and noise.
    """
    rng = np.random.default_rng(3)
    axis = np.linspace(-150e-6, 150e-6, points)
    tau = 2 * np.pi * np.arange(128) / 128
    shapes = film().projection.on_grid(axis, axis)
    frequency = film().modes.frequency
    second = shapes[np.argmin(np.abs(frequency - 2 * frequency[0]))]
    groups = {}
    for name, wavelength in lasers.items():
        turned = tau + rng.uniform(-0.2, 0.2)
        u = AMPLITUDE * shapes[0][..., None] * np.cos(turned) + overtone * second[
            ..., None
        ] * np.cos(2 * turned + 0.5)
        if stack and MODEL.stack is not None:
            fringe = MultilayerFringe(MODEL.stack, wavelength)
            v = CONTRAST / abs(fringe.fourier.coefficients[1]) * fringe(u + 3e-8)
        else:
            v = CONTRAST * np.cos(4 * np.pi / wavelength * u + rng.uniform(0.3, 1.2))
        values = np.moveaxis(np.fft.fft(v, axis=-1)[..., 1:5], -1, 0) / 64
        values = values + NOISE * (
            rng.standard_normal(values.shape) + 1j * rng.standard_normal(values.shape)
        )
        groups[name] = measurement.harmonic_map(
            axis,
            axis,
            np.arange(1, 5),
            values,
            noise_sd=NOISE,
            wavelength=wavelength,
            drive_frequency=float(frequency[0]),
        )
    measurement.write(measurement.bundle(groups, geometry="square-270um"), path)
    return path


def joint(path: Path, backwards: bool = False) -> JointModel:
    """Return the model of all measurements of a file."""
    return joint_with_effects(path, backwards)[0]


def joint_with_effects(path: Path, backwards: bool = False) -> tuple[JointModel, list[Effect]]:
    """Return the model of all measurements of a file, and the effects that can show in it."""
    groups = {
        name: pose(name, node.to_dataset(), MODEL)
        for name, node in measurement.read(path).children.items()
    }
    return pose_joint(groups, library().values(), backwards)


def test_two_maps_of_one_drive_share_the_amplitude_and_nothing_else(tmp_path: Path) -> None:
    base_model = joint(maps(tmp_path / "both.nc"))
    own = ("contrast", "theta", "motion_phase", "x", "y")
    assert {spec.name for spec in base_model.base} == {
        "amplitude",
        *(f"{laser}.{name}" for laser in LASERS for name in own),
    }
    start = ExtendedModel(base_model).split(base_model.start)[0]
    apart = [
        one.residuals([], {n: start[joined] for n, joined in base_model.names[g].items()}, [])
        for g, one in base_model.groups.items()
    ]
    np.testing.assert_array_equal(base_model.residuals([], start, []), np.concatenate(apart))


def test_effects_on_the_film_are_shared_and_those_of_a_detector_belong_to_its_laser(
    tmp_path: Path,
) -> None:
    base_model, effects = joint_with_effects(maps(tmp_path / "both.nc", points=9))
    pool = {effect.name: effect for effect in effects}
    assert [spec.name for spec in pool["mechanical_overtones"].parameters] == [
        "cos2",
        "sin2",
        "cos3",
        "sin3",
    ]
    assert [spec.name for spec in pool["detector_bandwidth"].parameters] == [
        "red.time_constant",
        "green.time_constant",
    ]
    assert pool["multilayer_fringe"].replaces == ("red.theta", "green.theta")
    slow = ExtendedModel(base_model, (pool["detector_bandwidth"],))
    base = (
        slow.split(np.zeros(len(slow.parameters)))[0]
        | ExtendedModel(base_model).split(base_model.start)[0]
    )
    plain, red, green = (
        slow.residuals(slow.pack(base, [{"red.time_constant": a, "green.time_constant": b}]))
        for a, b in ((0, 0), (1e-8, 0), (0, 1e-8))
    )
    half = len(plain) // 2
    assert not np.array_equal(plain[:half], red[:half])
    assert np.array_equal(plain[half:], red[half:])
    assert np.array_equal(plain[:half], green[:half])


def test_maps_without_a_cause_are_adequate_together_and_know_the_amplitude_better(
    tmp_path: Path,
) -> None:
    found = diagnose(maps(tmp_path / "both.nc"), effects=[library()[name] for name in FEW])
    assert (found.verdict, found.causes) == ("adequate", ())
    amplitude = found.parameters["base"]["amplitude"]
    assert abs(amplitude.value - AMPLITUDE) < 4 * amplitude.sd
    (bought,) = [note for note in found.notes if note.startswith("joint: amplitude")]
    alone = [float(part.split("±")[1].split()[0]) for part in bought.split("alone")[1].split(",")]
    assert " nm; alone red " in bought
    assert 1e9 * amplitude.sd == pytest.approx(sum(sd**-2 for sd in alone) ** -0.5, rel=0.1)


@pytest.mark.slow
def test_motion_in_metres_at_two_wavelengths_is_told_from_a_fringe(tmp_path: Path) -> None:
    found = diagnose(
        maps(tmp_path / "motion.nc", overtone=6e-9), effects=[library()[name] for name in FEW]
    )
    assert (found.verdict, found.causes) == ("explained", ("mechanical_overtones",)), (
        found.alternatives
    )
    for name, truth in (("cos2", 6e-9 * np.cos(0.5)), ("sin2", -6e-9 * np.sin(0.5))):
        size = found.parameters["mechanical_overtones"][name]
        assert abs(size.value - truth) < 4 * size.sd


@pytest.mark.slow
def test_rings_of_the_stack_at_two_wavelengths_are_told_from_motion(tmp_path: Path) -> None:
    found = diagnose(
        maps(tmp_path / "fringe.nc", stack=True), effects=[library()[name] for name in FEW]
    )
    assert (found.verdict, found.causes) == ("explained", ("multilayer_fringe",)), (
        found.alternatives
    )
    gap = found.parameters["multilayer_fringe"]["gap"]
    assert MODEL.stack is not None
    assert abs(gap.value - MODEL.stack.layers[MODEL.stack.gap].thickness - 3e-8) < 4 * gap.sd


def test_measurements_that_share_nothing_are_judged_side_by_side(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    pressure = np.geomspace(0.01, 1, 24)
    quality = 5e5
    damped = 1 / (1 / quality + 2.5e-6 * pressure)
    still = measurement.series(
        {"time": 60.0 * np.arange(24)}, 1.5e6 + 2 * rng.standard_normal(24), np.full(24, 2.0)
    )
    gas = measurement.series(
        {"pressure": pressure},
        None,
        None,
        damped * (1 + 0.01 * rng.standard_normal(24)),
        0.01 * damped,
    )
    measurement.write(
        measurement.bundle({"still": still, "gas": gas}, geometry="square-270um"),
        tmp_path / "two.nc",
    )
    found = diagnose(tmp_path / "two.nc")
    # Without frequencies, gas that is trapped and leaves at once damps about the same.
    assert found.causes == ("gas_damping",), found.alternatives
    assert {one.causes for one in found.alternatives} <= {("gas_damping",), ("trapped_gas",)}
    rate = found.parameters["gas_damping"]["per_pressure"]
    assert abs(rate.value - 2.5e-6) < 4 * rate.sd
    assert any("no parameter in common" in note for note in found.notes)


def test_causes_in_a_decay_and_a_record_count_in_the_unit_of_each(tmp_path: Path) -> None:
    """A decay counts amplitudes in that at its begin, a record in volts of its output."""
    rng = np.random.default_rng(5)
    bench = RecordBench(rng)
    bench.noise = 3e-4
    decays = {
        f"decay_{k}": measurement.decay(*record(k, points=200)[:2], attributes={"frequency": TONE})
        for k in range(2)
    }
    path = tmp_path / "both.nc"
    groups = {**decays, **bench.measured(bench.draw(rng), {}, rng)}
    measurement.write(measurement.bundle(groups, geometry="square-270um"), path)
    effects = {effect.name: effect for effect in joint_with_effects(path)[1]}
    damping = {spec.name: spec.unit for spec in effects["nonlinear_damping"].parameters}
    assert damping == {"decay_0.eta": "A0^-2", "decay_1.eta": "A0^-2", "record.eta": "V^-2"}
    assert [spec.unit for spec in effects["quintic_stiffness"].parameters] == ["V^-4"]
    few = [library()[name] for name in ("nonlinear_damping", "quintic_stiffness", "beating_pair")]
    assert diagnose(path, effects=few).verdict == "adequate"


def test_forces_on_two_modes_are_one_each(tmp_path: Path) -> None:
    """Sweeps of one mode share them, and all sweeps share what belongs to their laser."""

    def swept(mode: str) -> xr.Dataset:
        rng = np.random.default_rng(1)
        bench = ResponseBench("square-270um", (), rng)
        while bench.mode != mode:
            bench = ResponseBench("square-270um", (), rng)
        return bench.measured(bench.draw(rng), {}, rng)["response"]

    first, other = swept("1,1"), swept("2,2")
    groups = {"first": first, "again": first, "other": other}
    path = tmp_path / "sweeps.nc"
    measurement.write(measurement.bundle(groups, geometry="square-270um"), path)
    effects = {effect.name: effect for effect in joint_with_effects(path)[1]}
    of_modes = [spec.name for spec in effects["nonlinear_damping"].parameters]
    assert of_modes == ["first+again.eta", "other.eta"]
    assert [spec.name for spec in effects["crosstalk"].parameters] == ["real", "imag"]
    model = joint_with_effects(path)[0]
    extended = ExtendedModel(model, (effects["nonlinear_damping"],))
    base = dict(zip([spec.name for spec in model.base], model.start, strict=True))
    damping = dict.fromkeys(of_modes, 0.0)
    notes = model.bought(fit(extended, extended.pack(base, [damping])))
    (told,) = [note for note in notes if "nonlinear_damping" in note]
    assert told.startswith("joint: nonlinear_damping.first+again.eta ")
    assert "; alone first " in told
    assert ", again " in told
