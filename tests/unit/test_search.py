"""How causes are sought, left out and judged, on problems small enough to see through."""

from collections.abc import Callable
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from femnl import load
from femnl.core.checkpoint import remembered
from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.errors import ParameterError
from femnl.core.readout import Array
from femnl.diagnose.criticism import criticise
from femnl.diagnose.global_starts import scan
from femnl.diagnose.search import search
from femnl.diagnose.verdict import judge
from femnl.effects import library
from femnl.fits.least_squares import (
    CrossValidation,
    FitResult,
    covariance,
    cross_validate,
    fit,
    held_out,
)
from femnl.fits.spectrum.pose import pose as pose_spectrum
from femnl.io import measurement
from femnl.observe.extended import ExtendedModel
from femnl.observe.film import SimulatedFilm
from tests.unit.level import Level

BLOCKS = np.repeat(np.arange(4), 10)
PLACE = np.linspace(-1, 1, len(BLOCKS))


def line(data: Array, needs_global_search: bool = False) -> Level:
    return Level(data, BLOCKS, 100.0, needs_global_search=needs_global_search)


def effect(
    name: str, change: Callable[[float], Array], low: float = -10.0, whole: bool = False
) -> Effect:
    """Return an effect that adds a function of its strength to the prediction."""

    def act(value: Array, values: Values) -> Array:
        return (
            value + values["strength"] * change(values["power"])
            if whole
            else value + change(values["strength"])
        )

    power = (ParameterSpec("power", "1", 0.5, 4.5, strength=False, whole=True),) if whole else ()
    return Effect(
        name,
        "",
        (ParameterSpec("strength", "1", low, 10.0), *power),
        {"placement": act},
        "",
        "",
        "",
    )


SLOPE = effect("slope", lambda s: s * PLACE)


def solved(data: Array, *effects: Effect) -> FitResult:
    model = ExtendedModel(line(data), effects)
    return fit(model, model.pack({"level": 0.0}, [{"strength": 0.1}] * len(effects)))


def test_the_density_of_unseen_blocks_is_that_of_the_full_matrices() -> None:
    rng = np.random.default_rng(4)
    found = cross_validate(solved(3 + 2 * PLACE + rng.standard_normal(40), SLOPE), 20)
    density = 0.0
    square = 0.0
    columns = np.stack([np.ones(40), PLACE], axis=1)
    prior = 12 * np.diag([200.0**-2, 20.0**-2])
    data = 3 + 2 * PLACE + np.random.default_rng(4).standard_normal(40)
    for block in range(4):
        out = block == BLOCKS
        best = np.linalg.lstsq(columns[~out], data[~out], rcond=None)[0]
        known, known_before = (
            np.linalg.inv(columns[~out].T @ columns[~out] + p) for p in (0.0, prior)
        )
        spread, size = (
            np.eye(10) + columns[out] @ k @ columns[out].T for k in (known, known_before)
        )
        misfit = data[out] - columns[out] @ best
        density -= 0.5 * (misfit @ np.linalg.solve(spread, misfit) + np.linalg.slogdet(size)[1])
        square += misfit @ misfit
    assert found.density == pytest.approx(density, rel=1e-5)
    assert found.chi2_reduced == pytest.approx(square / 40, rel=1e-5)


@pytest.mark.slow
def test_the_p_value_of_unseen_blocks_is_as_small_as_it_says_where_the_model_is_right() -> None:
    rng = np.random.default_rng(8)
    drawn = np.array(
        [
            cross_validate(solved(3 + 2 * PLACE + rng.standard_normal(40), SLOPE), 20).p_value
            for _ in range(400)
        ]
    )
    for p in (0.05, 0.2, 0.5):
        rate = 1 - (1 - p / 4) ** 4
        assert abs(np.mean(drawn < p) - rate) < 3 * np.sqrt(rate * (1 - rate) / len(drawn))


def test_a_block_that_bends_over_what_the_others_leave_open_is_no_misfit() -> None:
    def bent(s: float) -> Array:
        return np.where(BLOCKS == 3, 10 * np.sin(3 * s * PLACE), s * PLACE)

    rng = np.random.default_rng(5)
    drawn = [
        cross_validate(
            solved(3 + bent(0.5) + rng.standard_normal(40), effect("bent", bent)), 20
        ).p_value
        for _ in range(50)
    ]
    assert min(drawn) > 0.01 / 50


def test_a_block_is_judged_by_its_level_and_not_by_its_noise() -> None:
    noise = np.random.default_rng(6).standard_normal(40)
    beside = 5.0 * np.array([1, -1, -1, 1, 0, 0, 1, -1, -1, 1])  # neither level nor slope
    loud = cross_validate(
        solved(3 + 2 * PLACE + noise + np.where(BLOCKS == 1, np.tile(beside, 4), 0), SLOPE), 20
    )
    assert loud.chi2_reduced > 2
    assert loud.p_value > 0.05
    higher = cross_validate(
        solved(3 + 2 * PLACE + noise + np.where(BLOCKS == 1, 2.5, 0), SLOPE), 20
    )
    assert higher.p_value < 1e-4


class Foreseen(FitResult):
    """A fit whose prediction of unseen data is given."""

    given = CrossValidation(1.0, (0.0,) * 4, 1.0, (10.0,) * 4, (10,) * 4)

    @property
    def cross_validation(self) -> CrossValidation:
        return self.given


def test_what_fits_all_data_but_predicts_no_part_from_the_others_explains_nothing() -> None:
    data = 3 + 2 * PLACE + np.random.default_rng(4).standard_normal(40)
    base, right = search(line(data), [SLOPE])
    assert judge([base, right]).verdict == "explained"

    class Bent(Foreseen):
        given = CrossValidation(
            4.0, right.result.cross_validation.densities, 1e-4, (40.0,) * 4, (10,) * 4
        )

    bent = replace(right, result=Bent(**vars_of(right.result)))
    assert judge([base, bent]).verdict == "unexplained"


def vars_of(result: FitResult) -> dict[str, Any]:
    return {field.name: getattr(result, field.name) for field in fields(result)}


class Weighed(Foreseen):
    """A fit whose evidence is given, too."""

    weight = 0.0

    @property
    def log_evidence(self) -> float:
        return self.weight


@pytest.mark.parametrize(
    ("odds", "verdict", "causes"),
    [(10, "ambiguous", 1), (60, "ambiguous", 2), (400, "explained", 2)],
)
def test_a_set_is_told_alone_from_99_percent_on_and_the_simplest_of_those_within_19_to_1_is_named(
    odds: float, verdict: str, causes: int
) -> None:
    wave = effect("wave", lambda s: s * np.cos(5 * PLACE))
    both = search(
        line(3 + 4 * PLACE + 3 * np.cos(5 * PLACE) + np.random.default_rng(4).standard_normal(40)),
        [SLOPE, wave],
    )
    base, best, one = (
        next(c for c in both if c.names == names) for names in ((), ("slope", "wave"), ("slope",))
    )

    class Rival(Weighed):
        weight = best.weight - np.log(odds) + np.log(10)
        given = best.result.cross_validation

    found = judge([base, best, replace(one, p_value=0.5, result=Rival(**vars_of(one.result)))])
    assert (found.verdict, len(found.chosen.names)) == (verdict, causes)


def test_scanning_finds_the_other_side_of_a_kink() -> None:
    kinked = effect("kinked", lambda s: 20 * abs(s) * np.sign(PLACE) + 4 * s * PLACE**2)
    data = 10 * np.sign(PLACE) - 2 * PLACE**2
    assert solved(data, kinked).chi2 > 10, "tangents lead to the other side"
    start, *_ = scan(solved(data), kinked)
    model = ExtendedModel(line(data), (kinked,))
    assert fit(model, model.pack(start.base, [start.values])).chi2 < 1e-6
    assert min(c.result.chi2 for c in search(line(data, needs_global_search=True), [kinked])) < 1e-6


def test_a_whole_number_is_found_and_stays_one() -> None:
    power = effect("power", lambda p: PLACE**p, whole=True)
    found = search(line(4 * PLACE**3 + np.random.default_rng(2).standard_normal(40) * 0.3), [power])
    _, values = found[-1].result.model.split(found[-1].result.vector)
    assert values[0]["power"] == 3
    assert values[0]["strength"] == pytest.approx(4, abs=0.4)


def test_what_is_most_telling_is_fitted_however_little_its_tangent_promises() -> None:
    # Nine effects that take up chance, and one of second order, whose secant at small strength
    # promises next to nothing.
    rng = np.random.default_rng(1)
    rows = rng.standard_normal((9, 40))
    weak = [effect(f"weak {k}", partial(np.multiply, row), low=-1.0) for k, row in enumerate(rows)]
    square = effect("square", lambda s: (s / 8) ** 2 * np.sin(7 * PLACE), low=0.0)
    found = search(line(3 + np.sin(7 * PLACE) + 1.2 * rng.standard_normal(40)), [*weak, square])
    assert ("square",) in [candidate.names for candidate in found]


def test_every_pair_that_does_as_well_as_the_best_is_found() -> None:
    # big + small and both + small say the same; alone, like is worth more than both.
    rng = np.random.default_rng(2)
    big = PLACE
    small = np.sin(7 * PLACE) - np.mean(np.sin(7 * PLACE) * PLACE) / np.mean(PLACE**2) * PLACE
    rows = {"big": big, "small": small, "both": big + small, "like": big + 0.5 * np.cos(5 * PLACE)}
    pool = [effect(name, partial(np.multiply, row), low=-30.0) for name, row in rows.items()]
    found = search(line(3 + 9 * big + 2 * small + 0.5 * rng.standard_normal(40)), pool)
    alone = sorted((c for c in found if len(c.names) == 1), key=lambda c: -c.weight)
    assert [c.names for c in alone[:2]] == [("big",), ("like",)]
    chi2 = {c.names: c.result.chi2 for c in found}
    assert chi2["both", "small"] == pytest.approx(chi2["big", "small"], rel=1e-6)
    assert judge(found).verdict == "ambiguous"


def test_a_shape_that_the_data_would_have_beyond_its_bound_is_stuck() -> None:
    def act(value: Array, values: Values) -> Array:
        return value + values["strength"] * (
            np.abs(PLACE) ** values["power"] + 1e-6 * values["idle"] * PLACE
        )

    specs = (
        ParameterSpec("power", "1", 0.5, 3.0, strength=False),
        ParameterSpec("idle", "1", 0.0, 5.0, strength=False),
    )
    bent = Effect(
        "bent",
        "",
        (ParameterSpec("strength", "1", 0.0, 20.0), *specs),
        {"placement": act},
        "",
        "",
        "",
    )
    noise = np.random.default_rng(3).standard_normal(40)
    for power, stuck in ((9.0, ["bent.power"]), (2.5, [])):
        model = ExtendedModel(line(3 + 9 * np.abs(PLACE) ** power + noise), (bent,))
        found = fit(
            model, model.pack({"level": 3.0}, [{"strength": 5.0, "power": 2.0, "idle": 5.0}])
        )
        sd = np.sqrt(found.covariance[2, 2])
        assert sd > 0.05 * 2.5, "the data hardly know it"
        assert found.stuck == stuck


@pytest.mark.parametrize(("truth", "stuck"), [(1.5, ["tilt.strength"]), (1.05, []), (0.9, [])])
def test_one_cause_may_end_at_its_largest_strength_where_smaller_ones_are_as_likely(
    truth: float, stuck: list[str]
) -> None:
    def act(value: Array, values: Values) -> Array:
        return value + values["strength"] * 3 * PLACE

    tilt = Effect(
        "tilt", "", (ParameterSpec("strength", "1", 0.0, 1.0),), {"placement": act}, "", "", ""
    )
    noise = np.sin(40 * PLACE)
    found = fit(ExtendedModel(line(3 + truth * 3 * PLACE + noise), (tilt,)), np.array([3.0, 0.5]))
    sd = float(np.sqrt(found.covariance[1, 1]))
    assert 0.05 < sd < 0.2
    assert criticise(found, [tilt]).stuck == stuck


def test_errors_of_parameters_stay_known_where_the_data_know_one_direction_far_better() -> None:
    # Two parameters of which only the sum shows, 1e12 times as sharply as their priors: the
    # difference keeps the priors' spread.
    found = covariance(1e12 * np.ones((3, 2)), np.ones(2))
    assert np.array([1, -1]) @ found @ np.array([1, -1]) == pytest.approx(2 / 12, rel=1e-6)
    assert np.all(np.linalg.eigvalsh(covariance(1e12 * np.ones((1, 2)), np.ones(2))) > -1e-15)


def test_a_cause_that_the_evidence_does_not_ask_for_saves_no_other() -> None:
    data = 3 + 2 * PLACE + np.random.default_rng(4).standard_normal(40)
    base, one = search(line(data), [SLOPE])

    class Bent(Foreseen):
        given = CrossValidation(
            4.0, one.result.cross_validation.densities, 1e-4, (40.0,) * 4, (10,) * 4
        )

    wider = solved(data, SLOPE, effect("bend", lambda s: s * PLACE**2))
    two = replace(one, result=wider)
    assert two.viable
    assert two.weight < one.weight
    assert judge([base, one, two]).verdict == "explained"
    bent = replace(one, result=Bent(**vars_of(one.result)))
    assert judge([base, bent, two]).verdict == "unexplained"


@pytest.mark.parametrize(("size", "fitted"), [(1.0, True), (30.0, False)])
def test_what_takes_the_place_of_a_part_is_not_fitted_where_it_leaves_absurdly_much(
    size: float, fitted: bool
) -> None:
    def act(value: Array, values: Values) -> Array:
        return value + size * np.sin(20 * PLACE + values["turn"])

    other = Effect(
        "other",
        "",
        (ParameterSpec("turn", "1", 0.0, 3.0, strength=False),),
        {"placement": act},
        "",
        "",
        "",
    )
    found = search(line(3 + 2 * PLACE + np.random.default_rng(4).standard_normal(40)), [other])
    assert any("other" in candidate.names for candidate in found) == fitted


@pytest.mark.slow
def test_a_fit_follows_a_curved_valley_to_its_end() -> None:
    # Slopes of the stress act in second order on the pairs of a hexagon: what the data know is a
    # circle of slopes.
    film = SimulatedFilm(load("hexagon-278um"), 52)
    base_model = pose_spectrum(
        measurement.spectrum(film.modes.frequency[:13], np.full(13, 20.0)), film
    )
    model = ExtendedModel(base_model, (library()["tension_gradient"],))
    base = dict(zip((spec.name for spec in base_model.base), base_model.start, strict=True))
    truth = model.pack(base, [{"slope_x": -0.0009, "slope_y": -0.0402, "bowl": -0.0069}])
    shifted = base_model.frequency - base_model.sd * model.residuals(truth)[:-1]
    model = replace(model, base_model=replace(base_model, frequency=shifted))
    assert np.sum(model.residuals(truth) ** 2) < 1e-12
    end = fit(model, model.pack(base, [{"slope_x": -0.0137, "slope_y": -0.0224, "bowl": -0.0074}]))
    assert end.chi2 < 1e-3


def test_a_rare_draw_of_noise_that_no_cause_is_worth_is_adequate() -> None:
    for seed in range(200):
        base, *others = search(line(np.random.default_rng(seed).standard_normal(40)), [SLOPE])
        if 1e-3 <= base.p_value < 0.01 and all(
            candidate.weight < base.weight for candidate in others
        ):
            break
    assert others
    assert judge([base, *others]).verdict == "adequate"
    assert judge([replace(base, p_value=1e-5), *others]).verdict != "adequate"


def test_kept_fits_are_those_of_the_blocks_that_they_leave_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    result = solved(3 + 2 * PLACE + np.random.default_rng(4).standard_normal(40), SLOPE)
    with remembered("a file") as checkpoint:
        kept = cross_validate(replace(result, checkpoint=checkpoint), 20)
    assert kept == cross_validate(result, 20)


def test_what_is_held_out_of_a_free_form_is_what_is_left_out_of_a_cause() -> None:
    result = solved(3 + 2 * PLACE + np.random.default_rng(4).standard_normal(40), SLOPE)
    assert held_out(result, 20) == pytest.approx(cross_validate(result, 20).chi2_reduced, rel=1e-12)


def test_causes_are_held_to_a_higher_p_value_than_the_base_model() -> None:
    base, one = search(line(3 + 2 * PLACE + np.random.default_rng(4).standard_normal(40)), [SLOPE])
    data = base.result.model.base_model.residuals((), {"level": 0.0}, ())
    two = replace(one, result=solved(data, SLOPE, effect("bend", lambda s: s * PLACE**2)))
    for p, verdicts in (
        (0.005, (True, False, False)),
        (0.02, (True, True, True)),
        (5e-4, (False, False, False)),
    ):
        assert tuple(replace(c, p_value=p).viable for c in (base, one, two)) == verdicts
    assert base.least_heldout == one.least_heldout < two.least_heldout


def test_a_range_that_counts_in_what_the_measurement_does_not_give_is_refused() -> None:
    odd = replace(SLOPE, parameters=(replace(SLOPE.parameters[0], scale="reech"),))
    with pytest.raises(
        ParameterError, match=r"parameter strength: its range counts in 'reech', .* it gives: time"
    ):
        _ = ExtendedModel(line(np.zeros(len(PLACE))), (odd,)).bounds


def wave(number: int, strength: float) -> Array:
    """Return a sine with that many half periods over the places."""
    return strength * np.sin(number * np.pi * PLACE)


def test_every_effect_is_fitted_alone_whatever_the_residuals_point_to() -> None:
    """Eight causes, of which tangents point to others than the last, which is of fourth order."""
    waves = [effect(f"wave {k}", partial(wave, k)) for k in range(1, 9)]
    late = effect("late", lambda s: s**4 * PLACE, low=0.0)
    data = 4 * PLACE + 0.3 * np.random.default_rng(3).standard_normal(PLACE.size)
    tried = {c.names for c in search(line(data), [*waves, late]) if len(c.names) == 1}
    assert {(e.name,) for e in (*waves, late)} <= tried


def test_a_value_far_from_its_bound_in_errors_is_not_stuck_however_wide_the_range() -> None:
    noise = 1e-9 * np.random.default_rng(4).standard_normal(PLACE.size)
    right = np.where(PLACE > 0, 1.0, 0.0)
    tiny = effect("tiny", lambda s: s * 1e9 * right, low=0.0)
    (found,) = [c for c in search(line(20 * right + 1e9 * noise), [tiny]) if c.names == ("tiny",)]
    # 2e-8 of a range of 10: a part of 2e-9, and sixty standard deviations from 0
    assert found.result.vector[-1] == pytest.approx(2e-8, rel=0.05)
    assert not found.result.stuck
    assert found.result.free.all()


def test_a_slow_valley_near_the_data_is_followed_as_long_as_a_fit_may_go_on() -> None:
    """Rosenbrock's valley: ten steps lower a χ² of 39 by less than a hundredth."""

    def bend(value: Array, values: Values) -> Array:
        x, y = values["x"], values["y"]
        moved = value.copy()
        moved[:2] += [1000 * (y - x**2), 1 - x]
        return moved

    specs = (ParameterSpec("x", "1", -10.0, 10.0), ParameterSpec("y", "1", -10.0, 10.0))
    valley = Effect("valley", "", specs, {"placement": bend}, "", "", "")
    data = np.random.default_rng(5).standard_normal(PLACE.size)
    data[:2] = 0.0
    model = ExtendedModel(line(data), (valley,))
    found = fit(model, np.array([0.0, -3.0, 9.0]))
    # 35.2 after 100 evaluations; a fit that gave up in the flat part would leave 38.6
    assert found.chi2 < 36


def test_a_weak_cause_in_noise_that_is_larger_than_stated_ends_the_search() -> None:
    """It takes up 4 % of χ² beyond stated noise, and all of it beyond the noise that it leaves."""
    place = np.linspace(-1, 1, 4000)
    noise = 1.4 * np.random.default_rng(3).standard_normal(place.size)
    data = 3 + 0.4 * np.sin(7 * place) + noise
    sine, wave = (
        effect(name, partial(np.multiply, shape))
        for name, shape in (("sine", np.sin(7 * place)), ("wave", np.cos(11 * place)))
    )
    base_model = Level(data, np.repeat(np.arange(4), 1000), 100.0)
    known = search(base_model, [sine, wave], other_noise=lambda best: 1.4)
    assert [candidate.names for candidate in known] == [(), ("sine",), ("wave",)]
    unknown = search(base_model, [sine, wave], other_noise=lambda best: 1.0)
    assert ("sine", "wave") in [candidate.names for candidate in unknown]


def test_a_fit_that_would_begin_at_no_number_says_so() -> None:
    with pytest.raises(FloatingPointError, match="no finite numbers"):
        fit(ExtendedModel(line(3 + PLACE), (SLOPE,)), np.array([3.0, np.nan]))
