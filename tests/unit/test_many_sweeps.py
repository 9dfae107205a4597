"""Sweeps under many sets of parameters at once are what each set gives by itself."""

from dataclasses import replace

import numpy as np
import pytest

from femnl import load
from femnl.core.effect import Effect, Values
from femnl.core.readout import Array
from femnl.core.stages import Oscillator, Signal
from femnl.diagnose.strength_slopes import Index, tangents
from femnl.effects import library
from femnl.fits.response.pose import pose
from femnl.io import measurement
from femnl.observe.extended import ExtendedModel
from femnl.observe.film import SimulatedFilm
from femnl.observe.model import MeasurementModel
from femnl.observe.noisy import FoundNoise, with_noise
from femnl.observe.response.branches import duffing_branches
from femnl.observe.response.many import AT_ONCE
from tests.unit.many_sets import alone, together

F0 = 2.9324e6
WIDTH = 4.0
SETS = 7


def driven(alpha: float, places: tuple[float, ...] = (0.0, 2e-5), points: int = 61) -> Array:
    """Return frequencies and sweeps (n_drives · n_places, points) of a Duffing resonator [V].

    alpha: stiffening at the strongest of three drives.
    """
    frequency = F0 + np.linspace(-40, 40, points)
    delta = 2 * (F0 - frequency) / WIDTH
    volts = []
    for drive in (0.2, 0.6, 1.0):
        bend = np.full(points, alpha * drive**2)
        both = duffing_branches(delta, bend, np.zeros(points), continued=False).x
        x = both[1] if alpha > 0 else both[0]
        motion = 2e-3 * drive / (delta + bend * x + 1j)
        volts += [(1 - 1e4 * place) * motion for place in places]
    return np.array(volts)


def posed(alpha: float) -> MeasurementModel:
    """Return the model of sweeps up at three drives and two places."""
    rng = np.random.default_rng(7)
    volts = driven(alpha)
    noise = rng.standard_normal(volts.shape) + 1j * rng.standard_normal(volts.shape)
    data = measurement.response(
        F0 + np.linspace(-40, 40, volts.shape[1]),
        volts + 1e-5 * noise,
        noise_sd=1e-5,
        wavelength=632.8e-9,
        mode="2,2",
        drive=np.repeat([0.2, 0.6, 1.0], 2),
        direction=1,
        x=np.tile([0.0, 2e-5], 3),
        y=np.zeros(6),
        time=100.0 * np.arange(6),
    )
    return pose(data, SimulatedFilm(load("square-270um"), 12))


@pytest.fixture(scope="module", params=[6.0, -6.0], ids=["stiffens", "softens"])
def sweeps(request: pytest.FixtureRequest) -> MeasurementModel:
    return posed(request.param)


def drawn(model: ExtendedModel, rng: np.random.Generator) -> Array:
    """Return vectors (SETS, p), two of which have no strength of some effect."""
    low, high = model.bounds
    part = rng.random((SETS, len(low)))
    vectors = low + (high - low) * part
    start = dict(zip((s.name for s in model.base_model.base), model.base_model.start, strict=True))
    for k, (owner, spec) in enumerate(model.parameters):
        if owner == "base":
            vectors[:, k] = start[spec.name] + 1e-3 * (high - low)[k] * (part[:, k] - 0.5)
        elif spec.strength:
            vectors[:2, k] = 0.0
    return np.clip(vectors, low, high)


def test_every_cause_of_sweeps_takes_many_sets(sweeps: MeasurementModel) -> None:
    rng = np.random.default_rng(1)
    effects = sweeps.usable_effects(library().values())
    assert len(effects) > 12
    for k, effect in enumerate(effects):
        assert effect.pointwise, effect.name
        for others in ((), (effects[k - 1],), (effects[k - 5],)):
            model = ExtendedModel(sweeps, (effect, *others))
            vectors = drawn(model, rng)
            single = alone(model, vectors)
            assert np.ptp(single, axis=0).max() > 1
            np.testing.assert_allclose(together(model, vectors), single, rtol=1e-9, atol=1e-9)


def test_glitches_and_correlated_noise_are_taken_into_account(sweeps: MeasurementModel) -> None:
    noisy = with_noise(sweeps, FoundNoise(glitches=(3, 70), factor=2.0, correlation=0.3))
    model = ExtendedModel(noisy, (library()["crosstalk"],))
    vectors = drawn(model, np.random.default_rng(2))
    np.testing.assert_allclose(together(model, vectors), alone(model, vectors), rtol=1e-12)


def test_more_sets_than_are_computed_at_once(sweeps: MeasurementModel) -> None:
    model = ExtendedModel(sweeps, (library()["nonlinear_damping"],))
    vectors = drawn(model, np.random.default_rng(3))
    many = np.tile(vectors, (AT_ONCE // (366 * SETS) + 2, 1))
    assert len(many) * 366 > AT_ONCE
    found = together(model, many)
    np.testing.assert_allclose(found[-SETS:], alone(model, vectors), rtol=1e-12)
    np.testing.assert_array_equal(found[:SETS], found[SETS : 2 * SETS])


def test_a_cause_that_looks_at_other_points_is_computed_by_itself(
    sweeps: MeasurementModel,
) -> None:
    def strongest(signal: Signal, values: Values) -> Signal:
        largest = float(np.abs(signal.voltage).max())
        return replace(signal, voltage=signal.voltage * (1 - values["part"] * largest))

    def pulled(mode: Oscillator, values: Values) -> Oscillator:
        return replace(mode, alpha=mode.alpha * float(1 + values["part"]))

    crosstalk = library()["crosstalk"]
    parameters = (replace(crosstalk.parameters[0], name="part", scale="", low=0.0, high=0.1),)
    for stage, change in (("signal", strongest), ("oscillator", pulled)):
        own = Effect("own", "", parameters, {stage: change}, "", "", "")
        model = ExtendedModel(sweeps, (crosstalk, own))
        vectors = drawn(model, np.random.default_rng(4))
        np.testing.assert_array_equal(together(model, vectors), alone(model, vectors))


def test_slopes_of_shapes_that_differ_by_orders_of_magnitude() -> None:
    size = 10.0 ** np.arange(-6, 5)

    def change(which: Index, strength: Array) -> Array:
        return np.outer(size[which] * strength, [3.0, 4.0])

    slopes, step = tangents(change, len(size), 1e-6, high=1e9, target=0.1)
    np.testing.assert_allclose(slopes, size[:, None] * np.array([3.0, 4.0]), rtol=1e-12)
    assert 0.01 < 5 * size[-1] * step < 1
