"""What causes take up of others: how it is measured, and what the files of effects state."""

from pathlib import Path

import numpy as np
import pytest

from femnl.core.effect import UNKNOWN
from femnl.effects import library
from tests.blind.imitations import SEED, draws, largest, taken
from tests.blind.realistic.files import make, prepared
from tests.blind.realistic.regimes import ALONE
from tests.blind.realistic.truth import residual


def test_the_largest_part_is_told_of_each_cause_that_is_another() -> None:
    rows = [
        {"kind": "map", "causes": ["tilt"], "taken": {"tilt": 1.0, "drift": 0.2}},
        {"kind": "map", "causes": ["tilt"], "taken": {"drift": 0.6, "bow": -0.1}},
        {"kind": "map", "causes": [], "taken": {"drift": 0.1}},
        {"kind": "trace", "causes": [], "taken": {}},
    ]
    assert largest(rows) == {
        "drift": {"map": {"tilt": 0.6, UNKNOWN: 0.1}},
        "bow": {"map": {"tilt": 0.0}},
    }


def test_a_cause_takes_up_its_own_record_and_little_of_another(tmp_path: Path) -> None:
    (draw,) = [d for d in draws(SEED, 1, ("record",)) if d.causes == ("nonlinear_damping",)]
    make(draw, tmp_path / "file.nc")
    kind, parts = taken(tmp_path / "file.nc")
    assert kind == "record"
    assert parts["nonlinear_damping"] == pytest.approx(1.0, abs=0.05)
    assert parts["quadratic_stiffness"] < 0.5


def test_what_is_alone_has_the_size_that_was_drawn() -> None:
    draw = next(d for d in draws(SEED, 1, ("record",)) if d.regime == ALONE.name)
    film = prepared(draw)
    assert not film.hidden
    assert film.options.unknown > 30
    _, off = residual(film.bench, film.base, {}, (), steps=0)
    assert np.linalg.norm(off(np.asarray(film.flat))) == pytest.approx(
        film.options.unknown, rel=1e-6
    )


def test_effects_state_causes_and_kinds_that_there_are() -> None:
    for effect in library().values():
        assert effect.imitates.keys() <= set(effect.kinds)
        for parts in effect.imitates.values():
            assert parts.keys() - {UNKNOWN} <= library().keys() - {effect.name}
            assert all(0 <= part <= 1 for part in parts.values())
