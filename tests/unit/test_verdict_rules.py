"""Rules of the verdict: every threshold states its study, and the rule that decides is recorded."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.diagnose.search import search
from femnl.diagnose.thresholds import THRESHOLDS, Thresholds, explain
from femnl.diagnose.verdict import RULES, judge
from tests.unit.level import Level
from tests.unit.test_worker_pool import BLOCKS, SLOPE

ROOT = Path(__file__).parents[2]


def test_every_threshold_has_a_meaning_and_a_study_that_is_there() -> None:
    described = explain(THRESHOLDS)
    assert [name for name, *_ in described] == [one.name for one in fields(Thresholds)]
    for name, value, meaning, study in described:
        assert value
        assert len(meaning) > 20, name
        pages = [word.strip(";,.:") for word in study.split() if "/" in word]
        assert pages, name
        assert all((ROOT / page).is_file() for page in pages), study


def test_every_rule_gives_its_reason() -> None:
    assert len({rule.__name__ for rule in RULES}) == len(RULES)
    assert all(rule.__doc__ for rule in RULES)


@pytest.mark.parametrize(
    ("rise", "bend", "verdict", "rule"),
    [
        (0.0, 0.0, "adequate", "base explains the data"),
        (2.0, 0.0, "explained", "one set stands alone"),
        (0.0, 9.0, "unexplained", "no set explains the data"),
    ],
)
def test_the_rule_that_decides_is_recorded(
    rise: float, bend: float, verdict: str, rule: str
) -> None:
    place = np.linspace(-1, 1, 40)
    noise = np.random.default_rng(1).standard_normal(40)
    base_model = Level(3 + rise * place + bend * place**2 + noise, BLOCKS, 100.0)
    judged = judge(search(base_model, [SLOPE]))
    assert (judged.verdict, judged.rule) == (verdict, rule)


class Estimated(Level):
    """The same with noise that is an estimate from its data."""

    estimates_noise = True


PLACE = np.linspace(-1, 1, 40)
WAYS = np.linalg.qr(PLACE[:, None] ** np.arange(4))[0][:, 1:]
"""Three ways (40, 3) to deviate from a constant, orthonormal."""


def bend(level: Array, values: Values) -> Array:
    """Add all three ways."""
    return np.asarray(level + WAYS @ [values[name] for name in "abc"])


BEND = Effect(
    "bend",
    "",
    tuple(ParameterSpec(name, "1", -100.0, 100.0) for name in "abc"),
    {"placement": bend},
    "",
    "",
    "",
)


def test_a_rare_misfit_is_no_cause_where_the_noise_is_an_estimate() -> None:
    """A deviation of 4.9σ, on which three strengths are spent: they cost more than it gains."""
    noise = 0.8 * np.random.default_rng(1).standard_normal(40)
    data = 3 + noise + WAYS @ (np.full(3, 4.9 / np.sqrt(3)) - WAYS.T @ noise)
    named = []
    for kind in (Level, Estimated):
        base, cause = search(kind(data, BLOCKS, 100.0), [BEND])
        assert not base.viable
        assert cause.viable
        assert cause.weight < base.weight
        named.append(judge([base, cause]).chosen.names)
    assert named == [("bend",), ()]
