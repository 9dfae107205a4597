"""Derivatives of residuals.

Parameters that are moved together give the same as one by one, whatever the effect.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from femnl import load
from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.memo import recent
from femnl.core.readout import Array
from femnl.effects import library
from femnl.fits.response.pose import pose as pose_response
from femnl.fits.tangents import TARGET, jacobian_at, steps_for, tangents
from femnl.fits.trace.pose import pose as pose_trace
from femnl.io import measurement
from femnl.observe.extended import ExtendedModel
from femnl.observe.film import SimulatedFilm
from femnl.observe.model import MeasurementModel
from tests.unit.level import Level

F0 = 2.9324e6
WIDTH = 4.0
STEPS = 4
PLACES = (1.0, 0.6, -0.4)


def unknown(model: ExtendedModel) -> Array:
    """First steps where nothing is known."""
    return steps_for(model, np.zeros(len(model.parameters)))


def traces() -> MeasurementModel:
    """Four steps of a drive through a resonance, read by a sinusoidal fringe."""
    rng = np.random.default_rng(2)
    film = SimulatedFilm(load("square-270um"), 12)
    f0 = float(film.modes.frequency[0])
    time = np.arange(600) / (60 * f0)
    frequency = f0 + np.linspace(-9, 9, STEPS)
    u = (
        3e-7
        / np.hypot(1, (frequency - f0) / 6)[:, None]
        * np.cos(2 * np.pi * frequency[:, None] * time)
    )
    volts = 0.02 * np.cos(4 * np.pi / 632.8e-9 * u + 0.8) + 5e-4 * rng.standard_normal(u.shape)
    return pose_trace(
        measurement.trace(
            time, volts, drive_frequency=frequency, noise_sd=5e-4, wavelength=632.8e-9
        ),
        film,
    )


def sweeps() -> MeasurementModel:
    """One sweep at each of three places, of different size and sign."""
    rng = np.random.default_rng(3)
    frequency = F0 + np.linspace(-40, 40, 61)
    volts = 2e-3 * np.array(PLACES)[:, None] / (1 + 2j * (frequency - F0) / WIDTH)
    volts = volts + 1e-5 * (
        rng.standard_normal(volts.shape) + 1j * rng.standard_normal(volts.shape)
    )
    drive = np.full(3, 0.1)
    x = [0.0, 2e-5, 8e-5]
    data = measurement.response(
        frequency,
        volts,
        noise_sd=1e-5,
        wavelength=632.8e-9,
        mode="2,2",
        drive=drive,
        direction=1,
        x=x,
        y=0.0,
    )
    return pose_response(data, SimulatedFilm(load("square-270um"), 12))


@pytest.mark.parametrize(("posed", "together"), [(traces, STEPS), (sweeps, len(PLACES))])
def test_what_is_moved_together_has_the_derivatives_of_each(
    posed: Callable[[], MeasurementModel], together: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    base_model = posed()
    effects = base_model.usable_effects(library().values())
    assert len(effects) > 5
    assert [len(group) for group in base_model.independent_blocks] == [together, together]
    base = dict(zip((spec.name for spec in base_model.base), base_model.start, strict=True))
    for effect in effects:
        model = ExtendedModel(base_model, (effect,))
        unit = {spec.name: base_model.scales.get(spec.scale, 1.0) for spec in effect.parameters}
        part = {spec.name: 1e-3 if spec.strength else 0.4 for spec in effect.parameters}
        small = {
            k.name: unit[k.name]
            * (part[k.name] * k.high + (not k.strength) * (1 - part[k.name]) * k.low)
            for k in effect.parameters
        }
        vector = model.pack(base, [small])
        at = model.residuals(vector)
        steps, whole = tangents(model, vector, at, unknown(model))
        assert np.array_equal(whole, jacobian_at(model, vector, at, steps)), effect.name
        with monkeypatch.context() as alone:
            alone.setitem(vars(base_model), "independent_blocks", ())
            single = jacobian_at(model, vector, at, steps)
            assert np.allclose(steps, tangents(model, vector, at, unknown(model))[0], rtol=1e-3), (
                effect.name
            )
        assert np.all(
            np.linalg.norm(whole - single, axis=0) <= 1e-6 * np.linalg.norm(single, axis=0)
        ), effect.name


def test_an_effect_may_replace_all_parameters_of_a_group() -> None:
    base_model = sweeps()
    gone = tuple(base_model.independent_blocks[0])
    effect = replace(library()["quintic_stiffness"], replaces=gone)
    model = ExtendedModel(base_model, (effect,))
    vector = np.append(base_model.start[[spec.name not in gone for spec in base_model.base]], 1e10)
    at = model.residuals(vector)
    steps, slopes = tangents(model, vector, at, unknown(model))
    assert (
        jacobian_at(model, vector, at, steps).shape
        == slopes.shape
        == (len(at), len(base_model.start) - len(gone) + 1)
    )


def test_steps_change_the_residuals_by_little_and_not_by_nothing() -> None:
    base_model = traces()
    model = ExtendedModel(base_model)
    at = model.residuals(base_model.start)
    low, high = model.bounds
    for first in (unknown(model), 1e-9 * (high - low), 0.01 * (high - low)):
        steps, slopes = tangents(model, base_model.start, at, first)
        assert np.all(np.abs(np.linalg.norm(slopes, axis=0) * steps / TARGET) < 5.1)
        assert np.all(np.abs(np.linalg.norm(slopes, axis=0) * steps / TARGET) > 0.19)


def test_latest_results_are_kept_and_the_oldest_given_up() -> None:
    asked: list[float] = []

    def twice(x: NDArray[np.float64]) -> NDArray[np.float64]:
        asked.append(float(x[0]))
        return 2 * x

    kept = recent(twice, most=2)
    for number in (1.0, 2.0, 1.0, 3.0, 1.0, 2.0):
        assert kept(np.array([number]))[0] == 2 * number
    assert asked == [1.0, 2.0, 3.0, 2.0]
    assert kept(np.array([1.0, 2.0])).shape == (2,)


def test_a_jump_at_a_sharp_frequency_leaves_a_step_that_moves_it() -> None:
    # 1e-11 of a range of 1 Hz is less than the last digit of 2.9 MHz
    def act(value: Array, values: Values) -> Array:
        return value + 30 * (values["place"] > F0)

    spec = ParameterSpec("place", "Hz", F0 - 0.5, F0 + 0.5)
    jump = Effect("jump", "", (spec,), {"placement": act}, "", "", "")
    model = ExtendedModel(Level(np.zeros(8), np.arange(8), 10.0), (jump,))
    vector = np.array([0.0, F0])
    steps, slopes = tangents(model, vector, model.residuals(vector), unknown(model))
    assert F0 + steps[1] > F0
    assert np.all(np.isfinite(slopes))
