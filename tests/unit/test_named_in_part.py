"""Causes that are named though something is left: several of them, or one of several alike."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.diagnose.discrepancy import log_evidence
from femnl.diagnose.run import decided
from femnl.diagnose.verdict import judge
from femnl.diagnose.weighing import Weighed
from tests.unit.level import Level
from tests.unit.test_inexact_equations import BLOCKS, PLACE, STRONG, N, candidate, cause


@pytest.mark.parametrize(("wave", "named"), [(8.0, ("line", "parabola")), (31.0, ("line",))])
def test_a_further_cause_takes_up_most_of_what_the_others_leave(
    wave: float, named: tuple[str, ...]
) -> None:
    """A wave is what no library has, and a parabola may be a part of that."""
    noise = np.random.default_rng(20261129).standard_normal(N)
    data = STRONG * PLACE + 90.0 * PLACE**2 + wave * np.sin(25 * PLACE) + noise
    model = Level(data, np.arange(N) % 6, 1e4, {"any swing": PLACE**3})
    line, parabola = (cause(name, k, 0.001) for name, k in (("line", 1), ("parabola", 2)))
    sets = ((), (line,), (parabola,), (line, parabola))
    judged = judge([candidate(model, *effects) for effects in sets])
    assert (judged.verdict, judged.chosen.names) == ("explained in part", named)


def test_causes_that_do_the_same_are_weighed_where_rounding_drowns_their_priors() -> None:
    """Fisher's information of their sum is 10²¹, that of their difference the priors' 12."""
    data = 1e9 * PLACE + np.random.default_rng(20261202).standard_normal(N)
    model = Level(data, BLOCKS, 1e12, {"any swing": PLACE**3})
    wide = (ParameterSpec("strength", "1", -1e10, 1e10),)
    line, like = (replace(cause(name, 1, 0.001), parameters=wide) for name in ("line", "like"))
    sets = [candidate(model), candidate(model, line), candidate(model, line, like)]
    share = Weighed(sets).graded.share
    assert sum(share.values()) == pytest.approx(1)
    assert share[("line",)] > share[("like", "line")]


def test_a_block_of_one_datum_counts_as_one_datum() -> None:
    """All data are one sweep, but for a known number from which the cause leads away."""
    noise = np.random.default_rng(20261201).standard_normal(N)
    data = STRONG * PLACE + 8.0 * np.sin(25 * PLACE) + noise
    known = np.arange(N) == N // 2 + 6
    data[known] = 0.4 * STRONG * PLACE[known]
    blocks = known.astype(np.int64)
    line = cause("line", 1, 0.001)
    model = Level(data, blocks, 1e4, {"any swing": PLACE**3})
    judged = judge([candidate(model), candidate(model, line)])
    assert (judged.verdict, judged.chosen.names) == ("explained in part", ("line",))


def richer(power: int) -> Effect:
    """A power of the place that may bend, by a more accurate equation than that of `cause`."""

    def bend(value: Array, values: Values) -> Array:
        return value + values["strength"] * PLACE**power + values["bend"] * PLACE**2

    like = cause("richer", power, 0.02)
    (spec,) = like.parameters
    parameters = (spec, replace(spec, name="bend"))
    return replace(like, changes={"placement": bend}, parameters=parameters)


@pytest.mark.parametrize(("power", "alike"), [(1, True), (3, False)])
def test_causes_that_do_the_same_are_told_apart_by_their_parameters_alone(
    power: int, alike: bool
) -> None:
    """A line and one that bends by nothing do the same, a line and a cubic do not."""
    noise = np.random.default_rng(20261129).standard_normal(N)
    data = 5 * STRONG * PLACE + 8.0 * np.sin(25 * PLACE) + noise
    model = Level(data, BLOCKS, 1e4, {"any swing": np.sin(5 * PLACE)})
    sets = [candidate(model, *those) for those in ((), (cause("line", 1, 0.1),), (richer(power),))]
    weighed = Weighed(sets)
    odds = np.log(weighed.graded.share["line",] / weighed.graded.share["richer",])
    line, other = (log_evidence(one, sets[0], weighed.graded.allowed) for one in sets[1:])
    if alike:
        assert line < other
        assert odds == pytest.approx(sets[1].weight - sets[2].weight)
    else:
        assert odds == pytest.approx(line - other)


class Beside(Level):
    """A level beside another measurement, which no parameter touches."""

    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        mine = np.arange(N) % 6 < 3
        return np.where(mine, super().residuals(effects, base, values), self.data)


def test_another_measurement_says_nothing_of_a_cause_that_it_cannot_show() -> None:
    """Its noise is a little larger than stated, which the cause does not mend."""
    noise = np.random.default_rng(20261129).standard_normal(N)
    other = np.arange(N) % 6 >= 3
    data = np.where(other, 1.1 * noise, STRONG * PLACE + 8.0 * np.sin(25 * PLACE) + noise)
    model = Beside(data, np.arange(N) % 6, 1e4, {"any swing": PLACE**3})
    judged = judge([candidate(model), candidate(model, cause("line", 1, 0.001))])
    assert (judged.verdict, judged.chosen.names) == ("explained in part", ("line",))


@pytest.mark.parametrize("wave", [8.0, 200.0])
def test_one_of_several_like_causes_is_told_whatever_a_further_one_adds_to_each(
    wave: float,
) -> None:
    """The likeliest sets have a parabola, too, which takes up too little to count."""
    noise = np.random.default_rng(20261130).standard_normal(N)
    data = STRONG * PLACE + 40.0 * PLACE**2 + wave * np.sin(25 * PLACE) + noise
    model = Level(data, np.arange(N) % 6, 1e4, {"any swing": PLACE**3})
    line, like = (cause(name, 1, 0.001) for name in ("line", "like"))
    parabola = cause("parabola", 2, 0.001)
    sets = ((), (line,), (like,), (parabola,), (line, parabola), (like, parabola))
    judged = judge([candidate(model, *effects) for effects in sets])
    if wave > STRONG / 2:
        assert judged.verdict == "unexplained"
        return
    assert judged.verdict == "ambiguous"
    told = {judged.chosen.names, *(rival.names for rival in judged.rivals)}
    assert told == {("line",), ("like",)}


def test_what_a_device_cannot_have_is_decided_and_what_was_not_recorded_is_not() -> None:
    """A film without holes is not dispersed by holes; without pressures, gas may be there."""
    model = Level(np.zeros(N), BLOCKS, 1e4)
    holes, timed, gas = (
        replace(cause(need, 1, 0.01), needs=(need,))
        for need in ("pitch_square", "time", "highest_pressure")
    )
    assert model.usable_effects([holes, timed, gas]) == [timed]
    assert decided([holes, timed, gas], model) == {"pitch_square", "time"}
