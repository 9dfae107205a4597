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


@pytest.mark.parametrize(("size", "rule"), [(4.9, "no set is likelier than the base"), (7.0, "")])
def test_a_misfit_is_no_cause_where_its_strengths_cost_more_than_it_gains(
    size: float, rule: str
) -> None:
    """A deviation too large for chance, on which three strengths are spent."""
    noise = 0.8 * np.random.default_rng(1).standard_normal(40)
    data = 3 + noise + WAYS @ (np.full(3, size / np.sqrt(3)) - WAYS.T @ noise)
    base, cause = search(Level(data, BLOCKS, 100.0), [BEND])
    assert not base.viable
    assert cause.viable
    judged = judge([base, cause])
    if rule:
        assert (judged.verdict, judged.chosen.names, judged.rule) == ("unexplained", (), rule)
    else:
        assert (judged.verdict, judged.chosen.names) == ("explained", ("bend",))
