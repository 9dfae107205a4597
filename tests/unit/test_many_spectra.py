"""Spectra under many sets of parameters at once are what each set gives by itself."""

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from femnl import load
from femnl.core.readout import Array
from femnl.effects import library
from femnl.fits.spectrum.pose import pose
from femnl.io import measurement
from femnl.observe.extended import ExtendedModel
from femnl.observe.film import SimulatedFilm
from femnl.observe.model import MeasurementModel
from femnl.observe.noisy import FoundNoise, with_noise
from femnl.observe.spectrum.matching import CLOSE, OWN, Index, by_label
from femnl.observe.spectrum.model import AT_ONCE
from tests.unit.many_sets import alone, together

SETS = 7
N_MODES = 11


def posed(geometry: str, *, labels: bool, losses: bool) -> MeasurementModel:
    """Return the model of a spectrum in gas, with times, and with or without labels and losses."""
    film = SimulatedFilm(load(geometry), 24)
    rng = np.random.default_rng(3)
    known: dict[str, Any] = {}
    if losses:
        known = {"quality_factor": np.geomspace(2e4, 4e5, N_MODES)}
        known["quality_factor_sd"] = 0.03 * known["quality_factor"]
    if labels:
        known["label"] = list(film.modes.label[:N_MODES])
    frequency = film.modes.frequency[:N_MODES] * (1 + 1e-4 * rng.standard_normal(N_MODES))
    data = measurement.spectrum(
        frequency if labels else np.sort(frequency),
        1e-5 * frequency,
        time=60.0 * rng.permutation(N_MODES),
        **known,
    )
    data.attrs["pressure"] = 300.0
    return pose(data, film)


CASES = {
    "square with labels and losses": ("square-270um", True, True),
    "square with labels": ("square-270um", True, False),
    "square with losses": ("square-270um", False, True),
    "hexagon with losses": ("hexagon-278um", False, True),
    "hexagon by rank": ("hexagon-278um", False, False),
}


LONG = ("square with labels and losses", "hexagon with losses", "hexagon by rank")
"""What the other cases have one of each, or a film that takes long to solve."""


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(case, id=name, marks=[pytest.mark.slow] if name in LONG else [])
        for name, case in CASES.items()
    ],
)
def spectrum(request: pytest.FixtureRequest) -> MeasurementModel:
    geometry, labels, losses = request.param
    return posed(geometry, labels=labels, losses=losses)


def drawn(model: ExtendedModel, rng: np.random.Generator, count: int = SETS) -> Array:
    """Return vectors (count, p), two of which have no strength of any effect."""
    low, high = model.bounds
    part = rng.random((count, len(low)))
    vectors = low + (high - low) * (0.4 + 0.2 * part)
    start = dict(zip((s.name for s in model.base_model.base), model.base_model.start, strict=True))
    for k, (owner, spec) in enumerate(model.parameters):
        if owner == "base":
            vectors[:, k] = start[spec.name] * (1 + 1e-3 * (part[:, k] - 0.5))
        elif spec.strength:
            vectors[:2, k] = 0.0
    return vectors


def test_every_cause_of_spectra_takes_many_sets(spectrum: MeasurementModel) -> None:
    rng = np.random.default_rng(1)
    effects = spectrum.usable_effects(library().values())
    assert len(effects) > 8
    for k, effect in enumerate(effects):
        for others in ((), (effects[k - 1],), (effects[k - 4],)):
            model = ExtendedModel(spectrum, (effect, *others))
            assert all(model._takes_many(one) for one in model.effects)
            vectors = drawn(model, rng)
            single = alone(model, vectors)
            assert np.ptp(single, axis=0).max() > 1
            np.testing.assert_allclose(together(model, vectors), single, rtol=1e-9, atol=1e-9)


def test_more_films_than_are_read_off_at_once(spectrum: MeasurementModel) -> None:
    noisy = with_noise(spectrum, FoundNoise(glitches=(3,), factor=2.0))
    model = ExtendedModel(noisy, (library()["frequency_drift"], library()["stress_anisotropy"]))
    vectors = drawn(model, np.random.default_rng(3), 2 * AT_ONCE + 3)
    np.testing.assert_allclose(together(model, vectors), alone(model, vectors), rtol=1e-9)


def test_films_exchange_labels_as_one_after_another() -> None:
    """Against an exchange of labels that is written down for one film."""
    rng = np.random.default_rng(5)
    own = np.tile([1.0, 1.001, 1.002, 1.5, 1.501, 2.0], (40, 1))
    turned = [np.linalg.qr(rng.standard_normal((6, 6)))[0] for _ in range(20)]
    turned += [np.eye(6)[rng.permutation(6)] for _ in range(20)]
    share = np.array(turned) ** 2
    changed = own + 0.003 * rng.standard_normal(own.shape)
    measured = own[0] + 0.003 * rng.standard_normal(6)
    sd = rng.uniform(1e-4, 1e-3, 6)

    def read_off(modes: Index, taken: Index) -> tuple[Array, Array]:
        # What is read off may depend on the mode as measured, as on its time
        frequency = np.take_along_axis(changed, taken, 1) * (1 + 1e-4 * modes)
        return np.asarray(frequency, float), np.asarray(taken, float)

    found, loss = by_label(share, own, measured, sd, read_off)
    exchanged = 0
    for k in range(len(share)):
        _, chosen = linear_sum_assignment(-share[k])
        place = chosen.tolist()
        for i, j in combinations(range(6), 2):
            mixed = all(share[k, m, chosen[m]] < OWN for m in (i, j))
            if mixed and abs(own[k, i] / own[k, j] - 1) < CLOSE:

                def misfit(one: int, other: int, i: int = i, j: int = j, k: int = k) -> float:
                    deviation = [
                        (measured[m] - changed[k, p] * (1 + 1e-4 * m)) / sd[m]
                        for m, p in ((i, one), (j, other))
                    ]
                    return float(np.sum(np.square(deviation)))

                if misfit(place[j], place[i]) < misfit(place[i], place[j]):
                    place[i], place[j] = place[j], place[i]
                    exchanged += 1
        expected = changed[k, place] * (1 + 1e-4 * np.arange(6))
        np.testing.assert_allclose(found[k], expected, rtol=1e-14)
        np.testing.assert_array_equal(loss[k], place)
    assert exchanged > 5
