"""Rules of the verdict: every threshold states its study, and the rule that decides is recorded."""

from dataclasses import fields
from pathlib import Path

from femnl.diagnose.thresholds import THRESHOLDS, Thresholds, explain
from femnl.diagnose.verdict import RULES

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
