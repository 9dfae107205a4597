"""A few score tests come first: they spare the others where they suffice, and change no verdict."""

import numpy as np

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.diagnose.criticism import criticise, glance
from femnl.diagnose.search_rules import outweighed
from femnl.diagnose.thresholds import THRESHOLDS
from femnl.fits.least_squares import FitResult, fit
from femnl.observe.extended import ExtendedModel
from tests.unit.level import Level

N = 60
X = np.linspace(-1, 1, N)
HALF = 30.0


class Telling(Level):
    """Data whose neighbours tell the noise."""

    tells_noise = True


def bump(name: str, width: float) -> Effect:
    """A bump of that width anywhere."""

    def lift(value: Array, values: Values) -> Array:
        shape = np.exp(-(((X - values["place"]) / width) ** 2))
        return np.asarray(value + values["size"] * shape)

    return Effect(
        name,
        "",
        (ParameterSpec("size", "1", -HALF, HALF), ParameterSpec("place", "1", -1, 1, False)),
        {"placement": lift},
        "",
        "",
        "",
    )


BUMPS = [bump("narrow", 0.1), bump("middling", 0.25), bump("wide", 0.7)]


def solved(data: Array, *effects: Effect, kind: type[Level] = Telling) -> FitResult:
    model = ExtendedModel(kind(data, np.arange(N) * 4 // N, HALF, {}), effects)
    starts = [{"size": 0.1, "place": place} for place in (0.1, -0.6)]
    return fit(model, model.pack({"level": 0.0}, starts[: len(effects)]))


def bumped(height: float, seed: int = 2) -> Array:
    noise = np.random.default_rng(seed).standard_normal(N)
    return np.asarray(noise + height * np.exp(-(((X - 0.1) / 0.25) ** 2)))


def test_a_few_tests_refute_what_all_of_them_do() -> None:
    data = bumped(5.0)
    first = criticise(solved(data), BUMPS).first_tests
    for effect in (BUMPS[0], BUMPS[2]):
        result = solved(data, effect)
        full = criticise(result, BUMPS)
        quick = criticise(result, BUMPS, first)
        assert quick.pointers is None  # no other test was made
        assert full.p_value < quick.p_value < THRESHOLDS.chance_excluded / 10
        assert quick.worst == full.worst == "middling"


def test_what_a_few_tests_do_not_refute_is_tested_in_every_way() -> None:
    for height in (1.0, 5.0):
        data = bumped(height)
        base = criticise(solved(data), BUMPS)
        right = solved(data, BUMPS[1])
        full = criticise(right, BUMPS)
        found = criticise(right, BUMPS, base.first_tests)
        assert found.p_value == full.p_value
        assert found.pointers == full.pointers
    # A misfit that is rare, but not too rare for chance
    doubtful = solved(bumped(4.0), BUMPS[0])
    first = criticise(solved(bumped(4.0)), BUMPS).first_tests
    found = criticise(doubtful, BUMPS, first)
    assert 1e-4 < found.p_value < THRESHOLDS.chance_excluded
    assert found.pointers is not None


def test_one_cause_that_larger_noise_would_save_is_not_refuted_by_a_few_tests() -> None:
    """Unless the data tell their noise."""
    data = 2.2 * bumped(3.0)
    for kind, tested in ((Level, True), (Telling, False)):
        base = criticise(solved(data, kind=kind), BUMPS)
        found = criticise(solved(data, BUMPS[1], kind=kind), BUMPS, base.first_tests)
        assert found.p_value < THRESHOLDS.chance_excluded / 10
        assert (found.pointers is not None) == tested
        assert (found.p_value_scaled > THRESHOLDS.base_inadequate) == tested


def test_noise_of_any_size_is_judged_alike() -> None:
    """The p-value of data in noise s is that of the same data in noise 1, s times as large."""
    stated = criticise(solved(bumped(0.0), kind=Level), BUMPS)
    factor = stated.factor
    result = solved(2.2 * bumped(0.0), kind=Level)
    larger = criticise(result, BUMPS)
    assert np.isclose(larger.factor, 2.2 * factor)
    assert np.isclose(larger.p_value_scaled, stated.p_value_scaled, rtol=1e-6)
    assert larger.p_value < 1e-6 < larger.p_value_scaled


def test_a_set_that_fewer_causes_outweigh_is_only_glanced_at() -> None:
    data = bumped(5.0)
    base = criticise(solved(data), BUMPS)
    right = criticise(solved(data, BUMPS[1]), BUMPS)
    wrong = criticise(solved(data, BUMPS[2]), BUMPS)
    pair = solved(data, BUMPS[1], BUMPS[2])
    full = criticise(pair, BUMPS)
    assert outweighed(full, [base, wrong, right])
    assert not outweighed(full, [base, wrong])
    assert not outweighed(right, [base, wrong])
    # A second bump that is there, too weak to be worth its parameters beyond even odds
    two = bumped(5.0, seed=4) + 1.5 * np.exp(-(((X + 0.6) / 0.1) ** 2))
    alone, both = (criticise(solved(two, *some), BUMPS) for some in (BUMPS[1:2], BUMPS[1::-1]))
    assert alone.weight > both.weight
    assert not outweighed(both, [base, alone])
    seen = glance(pair, BUMPS, base.first_tests)
    assert seen.pointers is None
    assert 0.05 < seen.p_value < 1
    # Tests of a misfit that is left still speak
    left = glance(solved(data, BUMPS[0], BUMPS[2]), BUMPS, base.first_tests)
    assert left.p_value < THRESHOLDS.set_inadequate
    assert left.worst == "middling"
