"""Memories of the latest results."""

from collections.abc import Mapping

import numpy as np
import pytest

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.memo import FEW, ROOM, recent, recent_of
from femnl.core.readout import Array
from femnl.observe.model import apply, remembering


def test_an_object_and_numbers_that_come_again_are_not_worked_out_again() -> None:
    asked: list[float] = []

    def find(place: list[float], numbers: Mapping[str, float]) -> float:
        asked.append(numbers["x"])
        return place[0] * numbers["x"]

    known = recent_of(find, most=2)
    place = [2.0]
    assert [known(place, {"x": x}) for x in (1.0, 3.0, 1.0)] == [2.0, 6.0, 2.0]
    assert asked == [1.0, 3.0]
    # The latest two are kept, whatever was asked for first
    assert [known(place, {"x": x}) for x in (4.0, 1.0, 3.0)] == [8.0, 2.0, 6.0]
    assert asked == [1.0, 3.0, 4.0, 3.0]


def test_another_object_of_the_same_content_is_another_one() -> None:
    known = recent_of(lambda place: [*place])
    first, second = [1.0], [1.0]
    assert known(first) is known(first)
    assert known(first) is not known(second)


@pytest.mark.parametrize(("size", "kept"), [(1, 20), (ROOM // 160, 10), (ROOM // 16, FEW)])
def test_of_long_results_fewer_are_kept(size: int, kept: int) -> None:
    """Arrays of float64 count as what was asked and as what was found, 16 bytes a number."""
    asked: list[float] = []

    def twice(x: Array) -> Array:
        asked.append(float(x[0]))
        return 2 * x

    known = recent(twice, most=20)
    numbers = range(30)
    for k in numbers:
        known(np.full(size, float(k)))
    asked.clear()
    for k in reversed(numbers):
        assert known(np.full(size, float(k)))[-1] == 2 * k
    assert asked[0] == numbers[-1] - kept


def test_what_effects_made_of_a_value_is_kept_for_each() -> None:
    made: list[str] = []

    def effect(name: str) -> Effect:
        def change(value: np.ndarray, values: Values) -> np.ndarray:
            made.append(name)
            return value + values["by"]

        return Effect(
            name=name,
            accuracy=0.0,
            accuracy_reason="exact",
            equation="v + by",
            parameters=(ParameterSpec("by", "1", 0.0, 1.0, reason="none"),),
            changes={"operators": change},
            source="none",
            limits="none",
            sentence="it adds",
        )

    both = (effect("one"), effect("other"))
    start = np.zeros(2)
    known = remembering("operators")
    for last in (1.0, 2.0):
        values = ({"by": 0.5}, {"by": last})
        found = known(start, both, values)
        assert np.array_equal(found, np.full(2, 0.5 + last))
    assert made == ["one", "other", "other"]
    assert np.array_equal(apply("operators", start, both, values), found)


def test_an_object_that_is_gone_is_not_taken_for_one_in_its_place() -> None:
    """A list that nobody keeps leaves its identity to the next one."""
    first = recent_of(lambda values: values[0])
    assert [first([k]) for k in range(100)] == list(range(100))
