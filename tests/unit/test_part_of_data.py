"""Fits to a part of many data, and which pairs of causes are not tried."""

from collections.abc import Sequence
from dataclasses import fields, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
import pytest

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.readout import Array, ComplexArray
from femnl.device.geometry import load
from femnl.diagnose.multistart import extended
from femnl.diagnose.part_of_data import best_in_all, in_part
from femnl.diagnose.score_tests import promising, score_tests, unlike
from femnl.diagnose.search import search
from femnl.effects import library
from femnl.fits.least_squares import fit
from femnl.fits.map.pose import pose as pose_map
from femnl.io import measurement
from femnl.observe.extended import ExtendedModel
from femnl.observe.film import SimulatedFilm
from femnl.observe.map.model import MapModel
from femnl.observe.noisy import FoundNoise, with_noise
from tests.unit.level import Level

SEED = 8
FILM = SimulatedFilm(load("square-270um"), 6)
SIDE = 71
BASE = {"amplitude": 3e-7, "contrast": 0.02, "theta": 0.8, "motion_phase": 0.3, "x": 0.0, "y": 0.0}
TILTED = {"slope_x": 6e-4, "slope_y": -3e-4}


@lru_cache
def wide(side: int = SIDE) -> MapModel:
    """A map of many places, measured line by line, with a gap and a tilted phase."""
    axis = np.linspace(-140e-6, 140e-6, side)
    about = {
        "noise_sd": 1e-5,
        "wavelength": 632.8e-9,
        "drive_frequency": float(FILM.modes.frequency[0]),
    }
    shape = FILM.projection.on_grid(axis, axis)[0]
    rough = np.array([shape, 0.1 * shape**2, 0.02 * shape**3]) * 0.02 * np.exp(0.3j)
    orders = [1, 2, 3]
    posed = pose_map(measurement.harmonic_map(axis, axis, orders, rough, **about), FILM)
    rng = np.random.default_rng(SEED)
    real, imaginary = 1e-5 * rng.standard_normal((2, *posed.measured.shape))
    volts = posed.predict([library()["phase_tilt"]], BASE, [TILTED]) + real + 1j * imaginary
    volts[1, ::7] = np.nan
    time = np.arange(side**2).reshape(side, side) * 0.1
    measured = volts.reshape(rough.shape)
    return pose_map(
        measurement.harmonic_map(axis, axis, orders, measured, time=time, **about), FILM
    )


@pytest.mark.parametrize("name", ["", "phase_tilt", "resonance_drift", "stage_scale", "doublet"])
def test_a_part_of_a_map_predicts_what_the_whole_map_does_there(name: str) -> None:
    model = wide()
    thin = model.thinned
    assert thin is not None
    assert thin.step == 2
    assert 4 * len(thin.at) == pytest.approx(len(model.blocks), rel=0.05)
    effects = [library()[name]] if name else []
    middle = [
        {spec.name: spec.low + 0.6 * (spec.high - spec.low) for spec in effect.parameters}
        for effect in effects
    ]
    whole = model.residuals(effects, BASE, middle)
    np.testing.assert_allclose(
        thin.model.residuals(effects, BASE, middle),
        whole[thin.at],
        atol=1e-9 * np.abs(whole).max(),
    )


def test_a_map_of_few_places_is_not_thinned() -> None:
    assert wide(45).thinned is None


def test_a_part_of_noisy_data_has_their_noise() -> None:
    model = wide()
    thin = model.thinned
    assert thin is not None
    glitch = int(thin.at[5])
    noisy = with_noise(model, FoundNoise((glitch, 1), 2.0))
    part = noisy.thinned
    assert part is not None
    whole = noisy.residuals([], BASE, [])
    np.testing.assert_allclose(part.model.residuals([], BASE, []), whole[part.at], rtol=1e-12)
    assert len(part.at) == len(thin.at) - 1
    assert part.model.variant != noisy.variant
    # Neighbours of the part are two steps apart
    correlated = with_noise(model, FoundNoise((), 1.0, 0.5)).thinned
    assert correlated is not None
    assert "correlation=0.25" in correlated.model.variant


@pytest.mark.parametrize("correlation", [0.0, 0.6])
def test_a_part_answers_to_parameters_as_its_own_residuals_do(correlation: float) -> None:
    """Neighbours of the part are farther apart, and correlated noise is less alike in them."""
    noisy = with_noise(wide(), FoundNoise((), 1.0, correlation))
    start = np.array([BASE[spec.name] for spec in noisy.base])
    part = in_part(fit(ExtendedModel(noisy), start, most=1))
    for k, step in enumerate((1e-11, 1e-6, 1e-5, 1e-5, 1e-10, 1e-10)):
        moved = step * np.eye(len(part.vector))[k]
        up, down = (part.model.residuals(part.vector + side * moved) for side in (1, -1))
        slope = (up - down) / (2 * step)
        size = np.linalg.norm(slope)
        assert np.linalg.norm(part.jacobian[:, k] - slope) < 1e-3 * size


def test_a_fit_that_a_part_of_the_data_led_is_that_to_all_of_them() -> None:
    model = wide()
    tilt = library()["phase_tilt"]
    base = fit(ExtendedModel(model), np.array([BASE[spec.name] for spec in model.base]))
    found = best_in_all(extended(base, tilt, [dict.fromkeys(TILTED, 1e-4)]), base)
    direct = fit(found.model, found.model.pack(BASE, [TILTED]))
    assert len(found.residuals) == len(model.blocks)
    assert found.chi2 == pytest.approx(direct.chi2, abs=0.01)
    sd = np.sqrt(np.diag(direct.covariance))
    np.testing.assert_allclose((found.vector - direct.vector) / sd, 0, atol=0.05)
    assert found.chi2 < 1.02 * found.degrees


def test_of_fits_to_a_part_the_one_that_all_data_prefer_goes_on() -> None:
    model = wide()
    base = fit(ExtendedModel(model), np.array([BASE[spec.name] for spec in model.base]))
    part = in_part(base)
    far = replace(part, vector=part.vector * np.array([1.2, 1, 1, 1, 1, 1]))
    found = best_in_all([far, part], base)
    assert found.chi2 == pytest.approx(base.chi2, rel=1e-6)


class Counted(MapModel):
    """A map that counts how often all of it is predicted."""

    predicted: ClassVar[list[int]] = [0]

    def predict(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> ComplexArray:
        self.predicted[0] += self.step == 1
        return super().predict(effects, base, values)


def test_a_part_of_the_data_tells_which_shapes_of_a_cause_are_tested_on_all_of_them() -> None:
    """They gain what the best of all shapes do, with a few of the tests of all data."""
    model = Counted(**{field.name: getattr(wide(), field.name) for field in fields(MapModel)})
    base = fit(ExtendedModel(model), np.array([BASE[spec.name] for spec in model.base]))
    shaped = [library()[name] for name in ("doublet", "resonance_drift")]
    model.predicted[0] = 0
    every = score_tests(base, shaped)
    of_all = model.predicted[0]
    few = score_tests(base, shaped, starts_alone=True)
    assert model.predicted[0] - of_all < of_all / 4
    assert len(few) >= len(every)
    for effect in shaped:
        best, led = (
            unlike([test for test in promising(base, found) if test.effect is effect])
            for found in (every, few)
        )
        assert led[0].basis.shape[1] == len(base.residuals)
        assert led[0].gain > 0.95 * best[0].gain > 100


N = 400
X = np.linspace(-1, 1, N)
HALF = 50.0


def shape(name: str, form: Array) -> Effect:
    """Something of that form on top of a level."""

    def lift(value: Array, values: Values) -> Array:
        return np.asarray(value + values["size"] * form)

    return Effect(
        name, "", (ParameterSpec("size", "1", -HALF, HALF),), {"placement": lift}, "", "", ""
    )


WAVES = [shape(f"wave{n}", np.cos(np.pi * n * (X + 1) / 2)) for n in (2, 5, 8, 13, 21, 34)]
BUMP = np.exp(-(((X - 0.3) / 0.05) ** 2))
ALIKE = [shape("rising", X), shape("nearly rising", X + 0.05 * BUMP)]


def told(data: Array, effects: list[Effect]) -> set[tuple[str, ...]]:
    found = search(Level(data, np.arange(N) * 4 // N, HALF), effects)
    return {candidate.names for candidate in found}


def test_pairs_of_causes_that_take_nothing_are_not_tried() -> None:
    noise = np.random.default_rng(SEED).standard_normal(N)
    unknown = 6.0 * np.sign(np.sin(40 * X)) / 10
    sets = told(noise + unknown, WAVES)
    assert len([names for names in sets if len(names) == 1]) == len(WAVES)
    assert len(sets) < 1 + len(WAVES) + 4


def test_what_two_causes_do_only_together_is_found_though_neither_takes_anything_alone() -> None:
    noise = np.random.default_rng(SEED).standard_normal(N)
    difference = 6.0 * (BUMP - X * (BUMP @ X) / (X @ X))
    sets = told(noise + difference, [*WAVES, *ALIKE])
    assert ("nearly rising", "rising") in sets
