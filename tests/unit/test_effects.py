"""The library of effects: every file keeps the contract, and idle effects change nothing."""

import numpy as np
import pytest

from femnl.core.effect import Effect, Stage
from femnl.core.kinds import kinds
from femnl.core.stages import (
    Dissipation,
    Harmonics,
    Lines,
    Oscillator,
    Placement,
    Points,
    Reading,
    Ringing,
    Signal,
)
from femnl.device.geometry import load
from femnl.effects import library

EFFECTS = list(library().values())
N = np.arange(1.0, 7.0)
FILM = load("square-270um").film
CONTROL = {
    "time": 10 * N,
    "temperature": 290 + N,
    "laser_power": 1e-6 * N,
    "pressure": N,
    "voltage": 1e-3 * N,
}
VALUES: dict[Stage, object] = {
    "frequencies": Lines(
        1e6 * N, 10 * N, 1e-6 * N, np.outer([0.2, 0.1, 0.05], 1 / N), FILM, 3e-6, 1.0
    ),
    "oscillator": Oscillator(
        np.full(6, 3e6),
        4.0,
        2e10,
        0.0,
        0.0,
        0.1 * N,
        1e-7,
        N,
        3e6 + N,
        3e6 + 2.5,
        np.zeros(6, complex),
    ),
    "signal": Signal(
        np.asarray(N * (1 + 2j), np.complex128),
        1e-8 * N,
        0.1 * N,
        633e-9,
        float(np.sqrt(180)),
        10 * N,
        N / 6,
    ),
    "placement": Placement(1e-5 * N, 2e-5 * N),
    "harmonics": Harmonics(np.outer(N, N).astype(complex), np.arange(1, 7), 1.0),
    "dissipation": Dissipation(-N, 0.3 + 0.01 * N, 0.3, 0.1 * N),
    "ringing": Ringing(N - 1, np.exp(-0.1 * N + 0.3j * N), 0.3, 1e6),
    "reading": Reading(N - 1, 1 + 0.1 * N, np.asarray(0.01j * N, np.complex128)),
    "points": Points(1e6 * N, 1e5 * N, CONTROL, FILM, 3e-6),
}


def numbers(effect: Effect, strength: float) -> dict[str, float]:
    """Strengths at a part of their range, the rest in the middle of it."""
    return {
        k.name: strength * k.high if k.strength else (k.low + k.high) / 2 for k in effect.parameters
    }


def arrays(value: object) -> list[np.ndarray]:
    """Everything numerical in the value of a stage."""
    return [
        np.asarray(part) for part in vars(value).values() if isinstance(part, float | np.ndarray)
    ]


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_an_effect_says_what_it_is_and_acts_at_stages_that_exist(effect: Effect) -> None:
    assert effect.equation
    assert effect.source
    assert effect.limits
    assert effect.sentence
    assert effect.kinds
    assert set(effect.changes) <= {stage for spec in kinds().values() for stage in spec.stages}
    # A strength that cannot be 0, as the damping of gas that is there, counts in its logarithm.
    assert all(
        spec.low < spec.high and (spec.low <= 0 or spec.log)
        for spec in effect.parameters
        if spec.strength
    )


@pytest.mark.parametrize(
    ("effect", "stage"),
    [(e, s) for e in EFFECTS for s in e.changes if s in VALUES],
    ids=lambda v: getattr(v, "name", v),
)
def test_an_effect_of_no_strength_changes_nothing_and_one_of_some_strength_does(
    effect: Effect, stage: Stage
) -> None:
    plain = VALUES[stage]
    idle, active = (effect.changes[stage](plain, numbers(effect, s)) for s in (0.0, 0.01))
    assert type(idle) is type(plain)
    for a, b in zip(arrays(plain), arrays(idle), strict=True):
        np.testing.assert_allclose(b, a, rtol=1e-14)
    assert any(not np.array_equal(a, b) for a, b in zip(arrays(plain), arrays(active), strict=True))


@pytest.mark.parametrize(
    "stage",
    ["oscillator", "frequencies", "points", "harmonics", "dissipation", "ringing", "reading"],
)
def test_effects_that_act_at_one_stage_commute_to_first_order(stage: Stage) -> None:
    acting = [e for e in EFFECTS if stage in e.changes]
    for first in acting:
        for second in acting:
            one = second.changes[stage](
                first.changes[stage](VALUES[stage], numbers(first, 1e-8)), numbers(second, 1e-8)
            )
            other = first.changes[stage](
                second.changes[stage](VALUES[stage], numbers(second, 1e-8)), numbers(first, 1e-8)
            )
            for a, b in zip(arrays(one), arrays(other), strict=True):
                np.testing.assert_allclose(a, b, rtol=1e-11)
