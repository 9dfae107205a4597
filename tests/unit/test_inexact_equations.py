"""A further cause beside one whose equation is inexact: a line, and a parabola that may bend it."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.diagnose.candidate import Candidate
from femnl.diagnose.criticism import criticise
from femnl.diagnose.distortions import Distortions
from femnl.diagnose.done_by import done_by, done_by_each
from femnl.diagnose.search import refitted
from femnl.diagnose.verdict import judge
from femnl.diagnose.weighing import Weighed
from femnl.fits.least_squares import fit
from femnl.observe.extended import ExtendedModel
from femnl.observe.model import MeasurementModel
from femnl.observe.noisy import FoundNoise, with_noise
from femnl.observe.residuals import Layout, Quantity, quadratures
from tests.unit.level import Level

N = 60
PLACE = np.linspace(-1, 1, N)
BLOCKS = np.repeat(np.arange(6), N // 6)
STRONG = 200.0
"""Strength of the line [σ]."""


def cause(name: str, power: int, accuracy: float) -> Effect:
    """Return an effect that adds a power of the place, times its strength."""

    def act(value: Array, values: Values) -> Array:
        return value + values["strength"] * PLACE**power

    spec = ParameterSpec("strength", "1", -1e4, 1e4)
    return Effect(name, "", (spec,), {"placement": act}, "", "", "", accuracy=accuracy)


def weighed(bend: float, accuracy: float) -> Weighed:
    """Return all sets of two causes, of data with a line and a parabola of so much of it."""
    noise = np.random.default_rng(20261125).standard_normal(N)
    data = STRONG * (PLACE + bend * PLACE**2) + noise
    model = Level(data, BLOCKS, 1e4, {"any bend": PLACE**2})
    line = cause("line", 1, accuracy)
    parabola = cause("parabola", 2, accuracy)
    return Weighed([candidate(model, *effects) for effects in ((), (line,), (line, parabola))])


def candidate(model: Level, *effects: Effect) -> Candidate:
    start = np.array([0.0, *(1.0 for effect in effects for _ in effect.parameters)])
    return criticise(fit(ExtendedModel(model, effects), start), [])


@pytest.mark.parametrize(
    ("bend", "accuracy", "verdict"),
    [
        # x² is x times what an equation may miss along the data
        (0.05, 0.05, "ambiguous"),
        # Accuracies are known to a factor: 10 % of an equation good to 1.5 %
        (0.1, 0.015, "ambiguous"),
        (0.1, 0.001, "explained"),
        # No equation misses more than its cause does: six times the largest accuracy of 25 %
        (1.5, 0.1, "explained"),
    ],
)
def test_a_further_cause_must_outdo_what_the_equation_of_the_first_may_miss(
    bend: float, accuracy: float, verdict: str
) -> None:
    sets = weighed(bend, accuracy)
    judged = judge(sets.found)
    assert judged.verdict == verdict
    named = ("line",) if verdict == "ambiguous" else ("line", "parabola")
    assert judged.chosen.names == named
    both = [rival.names for rival in judged.rivals]
    assert both == ([("line", "parabola")] if verdict == "ambiguous" else [])


def test_fewer_causes_are_not_named_where_a_rival_does_without_them() -> None:
    sets = weighed(0.05, 0.05)
    base, line, both = sets.found
    # The same parabola, by a cause that explains the data without any line
    other = replace(both, result=replace(both.result, model=renamed(both)))
    judged = judge([base, line, both, other])
    assert judged.chosen.names != ("line",)
    assert judged.verdict == "ambiguous"


def renamed(both: Candidate) -> ExtendedModel:
    effects = both.result.model.effects
    one, two = (replace(e, name=n) for e, n in zip(effects, ("curve", "tilt"), strict=True))
    return ExtendedModel(both.result.model.base_model, (one, two))


@pytest.mark.parametrize("apart", [1, 4])
def test_a_further_cause_that_acts_on_one_datum_is_not_beyond_doubt(apart: int) -> None:
    def act(value: Array, values: Values) -> Array:
        return value + values["strength"] * pulled

    pulled = np.zeros(N)
    pulled[[7, 20, 33, 46][:apart]] = 1.0
    noise = np.random.default_rng(20261128).standard_normal(N)
    model = Level(STRONG * PLACE + 30 * pulled + noise, BLOCKS, 1e4)
    line = cause("line", 1, 0.05)
    spec = ParameterSpec("strength", "1", -1e4, 1e4)
    pull = Effect("pull", "", (spec,), {"placement": act}, "", "", "", accuracy=0.05)
    sets = ((), (line,), (pull,), (line, pull))
    judged = judge([candidate(model, *effects) for effects in sets])
    named = ("line",) if apart == 1 else ("line", "pull")
    assert (judged.verdict, judged.chosen.names) == (
        "ambiguous" if apart == 1 else "explained",
        named,
    )


class Quadratures(Level):
    """Complex data: all real parts, then all imaginary ones."""

    @property
    def layout(self) -> Layout:
        none = np.full(N, -1)
        return Layout(np.empty((N, 0), np.int64), none, np.tile(np.arange(N // 2), 2), none)


def columns_of(done: Array, model: MeasurementModel) -> Array:
    """Return in what ways an equation may miss all data, by portions that do not divide them."""
    found = Distortions(done, model)
    columns = np.concatenate([found.of(slice(k, k + 7)) for k in range(0, len(done), 7)])
    assert columns.shape == (len(done), found.count)
    return columns


def spanned(columns: Array, wanted: Array) -> float:
    """Return the part of a deviation that columns cannot describe."""
    left = wanted - columns @ np.linalg.lstsq(columns, wanted, rcond=None)[0]
    return float(np.linalg.norm(left) / np.linalg.norm(wanted))


def test_an_equation_may_miss_the_phase_of_quadratures_as_well() -> None:
    model = Quadratures(np.zeros(N), BLOCKS, 1e4)
    place = np.linspace(-1, 1, N // 2)
    rng = np.random.default_rng(20261126)
    done = rng.standard_normal(N // 2) + 1j * rng.standard_normal(N // 2)
    columns = columns_of(parts(done), model)
    # A further pole delays each harmonic, and takes from it, as smoothly along the data
    assert spanned(columns, parts(1j * done)) < 1e-12
    assert spanned(columns, parts((0.3j * place + 0.1 * place**2) * done)) < 1e-12
    assert spanned(columns, parts(place**2 * np.conj(done))) > 0.5
    # Data of one part have no phase
    alone = columns_of(parts(done), Level(np.zeros(N), BLOCKS, 1e4))
    assert spanned(alone, parts(1j * done)) > 0.5


class Plane(Quadratures):
    """Three harmonics of ten places, in both quadratures."""

    @property
    def layout(self) -> Layout:
        return replace(super().layout, planar=True)

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        harmonic = np.repeat([1, 2, 3], N // 6)
        x = np.tile(np.arange(N // 6), 3)
        return quadratures("harmonics", "V", np.ones(N // 2), {"n": (harmonic, ""), "x": (x, "m")})


def test_an_equation_may_miss_one_harmonic_as_it_does_at_every_place() -> None:
    model = Plane(np.zeros(N), BLOCKS, 1e4)
    rng = np.random.default_rng(20261127)
    done = rng.standard_normal(N // 2) + 1j * rng.standard_normal(N // 2)
    # Gains of three harmonics: what grows with their number, and its square, spans them
    gains = np.repeat(rng.standard_normal(3) + 1j * rng.standard_normal(3), N // 6)
    gains -= gains[N // 4].real  # what all share is another strength of the cause
    assert spanned(columns_of(parts(done), model), parts(gains * done)) < 1e-9
    seen = with_noise(model, FoundNoise(glitches=(3, 3 + N // 2)))
    kept = np.delete(np.arange(N), [3, 3 + N // 2])
    assert spanned(columns_of(parts(done)[kept], seen), parts(gains * done)[kept]) < 1e-9


def parts(values: NDArray[np.complexfloating[Any, Any]] | Array) -> Array:
    return np.concatenate([values.real, values.imag])


def test_what_is_fitted_again_is_tried_without_each_of_its_causes() -> None:
    base, _, both = weighed(0.6, 0.1).found
    again = refitted(base.result.model.base_model, [], [base, both])
    assert ("line",) in [found.names for found in again]
    assert ("parabola",) in [found.names for found in again]


def test_a_cause_that_the_base_model_balances_does_no_more_than_it_takes_up() -> None:
    def act(value: Array, values: Values) -> Array:
        return value + values["strength"] * (1 + 0.01 * PLACE)

    spec = ParameterSpec("strength", "1", -1e5, 1e5)
    offset = Effect("offset", "", (spec,), {"placement": act}, "", "", "", accuracy=0.05)
    noise = np.random.default_rng(20261125).standard_normal(N)
    model = Level(STRONG * PLACE + noise, BLOCKS, 1e5)
    base = candidate(model)
    found = candidate(model, offset)
    assert abs(found.result.vector[1]) > 50 * STRONG
    taken = np.linalg.norm(base.result.residuals - found.result.residuals)
    assert np.linalg.norm(done_by(found, base, offset)) == pytest.approx(taken, rel=1e-6)


class Halves(Level):
    """Two quantities, of half of the data each."""

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        halves = np.split(np.arange(N), 2)
        return tuple(Quantity(str(k), "", at, np.ones(N // 2), {}) for k, at in enumerate(halves))


def of_halves(first: Array | float, second: Array | float) -> Array:
    return np.concatenate([np.broadcast_to(half, N // 2) for half in (first, second)])


def line_in_halves(name: str, first: float, second: float) -> Effect:
    """Return an effect that adds lines to both halves of the data, times its strength."""
    line = PLACE[::2] + 1 / N
    along = of_halves(first * line, second * line)

    def act(value: Array, values: Values) -> Array:
        return value + values["strength"] * along

    spec = ParameterSpec("strength", "1", -1e4, 1e4)
    return Effect(name, "", (spec,), {"placement": act}, "", "", "", accuracy=0.1)


def test_causes_that_cancel_make_no_room_for_what_is_unknown() -> None:
    loss, gas, mass = (
        line_in_halves(name, first, second)
        for name, first, second in (("loss", 1, 0), ("gas", 1, 1), ("mass", 0, -1))
    )
    noise = np.random.default_rng(20261128).standard_normal(N)
    unknown = of_halves(0, 10 * np.sin(5 * PLACE[::2]))
    true = STRONG * of_halves(PLACE[::2] + 1 / N, 0)
    model = Halves(true + unknown + noise, BLOCKS, 1e4)
    sets = ((), (loss,), (mass,), (gas, mass), (loss, mass))
    found = [candidate(model, *effects) for effects in sets]
    both = found[3]
    first, second = np.split(done_by_each(both, found[0])[0], 2)
    assert np.abs(first).max() > 0.9 * STRONG
    assert np.abs(second).max() < 30
    assert np.abs(done_by(both, found[0], gas)[N // 2 :]).max() > 0.9 * STRONG
    assert Weighed(found).graded.share["loss",] > 0.5


def test_causes_that_do_not_cancel_may_each_miss_what_they_do() -> None:
    base, _, both = weighed(1.5, 0.1).found
    for one, effect in zip(done_by_each(both, base), both.result.model.effects, strict=True):
        np.testing.assert_allclose(one, done_by(both, base, effect), rtol=0.01)


@pytest.mark.parametrize(("directions", "surer"), [(3, False), (24, True)])
def test_causes_must_be_surer_where_smooth_directions_span_much_of_the_data(
    directions: int, surer: bool
) -> None:
    noise = np.random.default_rng(20261126).standard_normal(N)
    waves = {f"wave {k}": np.cos(k * np.pi * (PLACE + 1) / 2) for k in range(1, directions + 1)}
    model = Level(STRONG * PLACE + noise, BLOCKS, 1e4, waves)
    line = cause("line", 1, 0.05)
    found = Weighed([candidate(model, *effects) for effects in ((), (line,))])
    assert found.graded.least_inclusion == (0.999 if surer else 0.99)
    assert found.graded.least_share(found.found[1]) == (0.99 if surer else 0.9)


class OfSweeps(Level):
    kind = "response"


@pytest.mark.parametrize(("accuracy", "least"), [(0.01, 0.99), (0.1, 0.96), (0.3, 0.9)])
def test_causes_of_one_resonance_may_leave_what_their_equations_may_miss(
    accuracy: float, least: float
) -> None:
    noise = np.random.default_rng(20261127).standard_normal(N)
    model = OfSweeps(STRONG * PLACE + noise, BLOCKS, 1e4)
    line = candidate(model, cause("line", 1, accuracy))
    found = Weighed([candidate(model), line])
    assert found.graded.least_share(line) == pytest.approx(least)


@pytest.mark.parametrize(("considered", "least"), [((), 0.99), (("lacking",), 0.96)])
def test_a_cause_of_one_resonance_may_not_where_it_imitates_one_that_was_not_considered(
    considered: tuple[str, ...], least: float
) -> None:
    noise = np.random.default_rng(20261127).standard_normal(N)
    model = OfSweeps(STRONG * PLACE + noise, BLOCKS, 1e4)
    imitates: dict[str, dict[str, float]] = {"response": {"lacking": 0.9, UNKNOWN: 0.95}}
    line = candidate(model, replace(cause("line", 1, 0.1), imitates=imitates))
    found = Weighed([candidate(model), line], considered=frozenset({"line", *considered}))
    assert found.graded.least_share(line) == pytest.approx(least)


class OfPlaces(Level):
    kind = "trace"


@pytest.mark.parametrize(
    ("imitates", "least"),
    [
        ({}, 0.99),
        ({"map": {UNKNOWN: 0.2}}, 0.99),
        ({"trace": {UNKNOWN: 0.99}}, 0.99),
        ({"trace": {UNKNOWN: 0.9}}, 0.95),
        ({"trace": {UNKNOWN: 0.2}}, 0.78),
        ({"trace": {"parabola": 0.9}}, 0.99),
        ({"trace": {"lacking": 0.6, UNKNOWN: 0.2}}, 0.99),
        # Where what it imitates was considered, data tell the two apart
        ({"trace": {"parabola": 0.9, UNKNOWN: 0.2}}, 0.78),
    ],
)
def test_a_cause_may_leave_more_where_it_imitates_none_that_was_not_considered(
    imitates: dict[str, dict[str, float]], least: float
) -> None:
    noise = np.random.default_rng(20261128).standard_normal(N)
    model = OfPlaces(STRONG * PLACE + noise, BLOCKS, 1e4)
    line = replace(cause("line", 1, 0.01), imitates=imitates)
    both = (line, replace(cause("parabola", 2, 0.01), imitates=imitates))
    found = [candidate(model, *effects) for effects in ((), (line,), both)]
    graded = Weighed(found, considered=frozenset({"line", "parabola"})).graded
    assert graded.least_share(found[1]) == pytest.approx(least)
    # Two causes imitate a third in the right ratio, whatever each does alone
    assert graded.least_share(found[2]) == 0.99


@pytest.mark.parametrize("considered", [(), ("parabola",)])
def test_a_cause_beside_something_unknown_is_named_where_nothing_else_may_be_it(
    considered: tuple[str, ...],
) -> None:
    rng = np.random.default_rng(20261129)
    lump = np.exp(-0.5 * ((PLACE - 0.3) / 0.2) ** 2)
    data = STRONG * (PLACE + 0.3 * lump) + rng.standard_normal(N)
    waves = {f"wave {k}": np.cos(k * np.pi * (PLACE + 1) / 2) for k in range(1, 8)}
    model = OfPlaces(data, BLOCKS, 1e4, waves)
    imitated = {"trace": {"parabola": 0.9, UNKNOWN: 0.2}}
    line = replace(cause("line", 1, 0.01), imitates=imitated)
    judged = judge([candidate(model), candidate(model, line)], considered=frozenset(considered))
    assert judged.verdict == ("explained in part" if considered else "unexplained")


@pytest.mark.parametrize(
    ("size", "alike", "verdict", "rule"),
    [
        (1.0, False, "explained", "one set stands alone"),
        (2.0, False, "explained", "causes explain the data within larger noise"),
        (2.0, True, "ambiguous", "causes explain the data within larger noise"),
        (4.0, False, "unexplained", "no set explains the data"),
    ],
)
def test_a_cause_may_leave_noise_that_is_larger_than_stated(
    size: float, alike: bool, verdict: str, rule: str
) -> None:
    noise = np.random.default_rng(20261126).standard_normal(N)
    model = Level(3 * size * PLACE + size * noise, BLOCKS, 1e4, {"any bend": PLACE**2})
    assert not model.tells_noise
    line = cause("line", 1, 0.05)
    other = cause("other line" if alike else "parabola", 1 if alike else 2, 0.05)
    judged = judge([candidate(model, *effects) for effects in ((), (line,), (other,))])
    assert (judged.verdict, judged.chosen.names, judged.rule) == (
        verdict,
        judged.chosen.names,
        rule,
    )
    if verdict != "unexplained":
        assert judged.chosen.names[0] in ("line", "other line")
    if judged.noisier:
        assert judged.inflation == pytest.approx(size, rel=0.3)


def test_a_cause_beside_larger_noise_predicts_what_is_held_out() -> None:
    noise = np.random.default_rng(20261126).standard_normal(N)
    model = Level(6 * PLACE + 2 * noise, BLOCKS, 1e4, {"any bend": PLACE**2})
    base, line = candidate(model), candidate(model, cause("line", 1, 0.05))
    assert judge([base, line]).chosen.names == ("line",)
    bent = replace(line, result=replace(line.result))
    vars(bent.result)["cross_validation"] = base.result.cross_validation
    assert judge([base, bent]).verdict == "unexplained"


def test_what_is_within_the_stated_noise_needs_no_larger_one() -> None:
    noise = np.random.default_rng(20261126).standard_normal(N)
    line = cause("line", 1, 0.05)
    within, beyond = (
        candidate(Level(6 * PLACE + size * noise, BLOCKS, 1e4), line) for size in (1.2, 2.0)
    )
    assert within.factor > 1
    assert not within.may_be_noisier
    assert beyond.may_be_noisier
