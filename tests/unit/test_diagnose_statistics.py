"""The statistics under a verdict on straight lines, where each has a closed form.

p-value, evidence, unseen data, order of effects.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import kstest, norm

from femnl import load
from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.core.stages import Placement
from femnl.diagnose import score_test
from femnl.diagnose.candidate import Candidate
from femnl.diagnose.criticism import criticise
from femnl.diagnose.score_tests import score_tests
from femnl.diagnose.search import refitted, search
from femnl.diagnose.thresholds import THRESHOLDS
from femnl.diagnose.verdict import judge
from femnl.effects import library
from femnl.fits.least_squares import DECADES, LONG, FitResult, fit, stored
from femnl.fits.spectrum.pose import BENDING_SD
from femnl.fits.spectrum.pose import pose as pose_spectrum
from femnl.io import measurement
from femnl.observe.extended import ExtendedModel
from femnl.observe.film import SimulatedFilm
from femnl.observe.model import apply
from tests.unit.level import Level

N = 48
X = np.linspace(-1, 1, N)
BLOCKS = np.arange(N) * 4 // N
HALF = 30.0
"""Half of the range of every parameter."""


def level(data: Array) -> Level:
    return Level(data, BLOCKS, HALF, {"halves": np.sign(X)})


def wave(order: int) -> Effect:
    """A cosine of that order of the place, of either sign."""
    return Effect(
        f"wave{order}",
        "",
        (ParameterSpec("size", "1", -HALF, HALF),),
        {
            "placement": lambda value, values: (
                value + values["size"] * np.cos(np.pi * order * (X + 1) / 2)
            )
        },
        "",
        "",
        "",
    )


WAVES = [wave(n) for n in (1, 2, 3, 5, 8, 13)]


def solved(data: Array, *effects: Effect) -> FitResult:
    model = ExtendedModel(level(data), effects)
    return fit(model, model.pack({"level": 0.0}, [{"size": 0.1}] * len(effects)))


def test_the_p_value_of_noise_is_uniform_however_many_looks_are_taken() -> None:
    rng = np.random.default_rng(11)
    p = [criticise(solved(rng.standard_normal(N)), WAVES).p_value for _ in range(60)]
    assert kstest(p, "uniform").pvalue > 0.01


@pytest.mark.slow
def test_the_p_value_of_noise_is_uniform_where_equal_frequencies_have_no_names() -> None:
    rng = np.random.default_rng(12)
    film = SimulatedFilm(load("square-270um"), 14)
    sd = np.full(12, 3.0)
    p = []
    for _ in range(300):
        layer = film.bending_length * (1 + BENDING_SD * rng.standard_normal())
        frequency = np.sort(film.frequency(film.speed, layer)[:12] + sd * rng.standard_normal(12))
        base_model = pose_spectrum(measurement.spectrum(frequency, sd), film)
        # Of each pair the higher value goes to the higher mode, so that pairs look split in one
        # sense.
        p.append(
            criticise(
                fit(ExtendedModel(base_model), base_model.start), [library()["shear_stress"]]
            ).p_value
        )
    assert kstest(p, "uniform").pvalue > 0.01


def test_a_p_value_too_small_to_be_simulated_counts_every_look() -> None:
    shape = np.cos(np.pi * (X + 1) / 2)
    result = solved(6.0 * shape / np.linalg.norm(shape))
    found = criticise(result, WAVES)
    own = next(test for test in score_tests(result, WAVES) if test.name == "wave1")
    # Six waves, one pattern, and χ², the largest outlier and the neighbours.
    assert own.p_value == pytest.approx(2 * norm.sf(6), rel=1e-3)
    assert found.p_value == pytest.approx(10 * own.p_value, rel=1e-12)


@pytest.mark.parametrize("size", [0.0, 3.0, 1e4])
def test_single_precision_of_long_tests_changes_no_p_value(
    size: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    count = LONG + 1
    place = np.linspace(-1, 1, count)
    bend = np.cos(7 * place)
    data = np.random.default_rng(7).standard_normal(count) + size * bend / np.linalg.norm(bend)
    sides = {"halves": np.sign(place), **{f"wave{k}": np.cos(k * place) for k in range(1, 20)}}
    model = Level(data, np.arange(count) * 4 // count, HALF, sides)
    result = fit(ExtendedModel(model), np.array([0.0]))
    short = criticise(result, [])
    assert score_tests(result, [])[0].basis.dtype == np.float32
    monkeypatch.setattr(score_test, "LONG", count)
    assert score_tests(result, [])[0].basis.dtype == np.float64
    assert short.p_value == pytest.approx(criticise(result, []).p_value, rel=1e-4)


def test_derivatives_of_long_data_are_kept_in_single_precision_where_that_holds_them() -> None:
    slopes = np.random.default_rng(8).standard_normal((LONG + 1, 2)) * [1e30, 1e-30]
    lean = stored(slopes)
    assert lean.dtype == np.float32
    np.testing.assert_allclose(lean, slopes, rtol=1e-7)
    few = slopes[:LONG]
    large = 1e10 * slopes
    assert stored(few) is few
    assert stored(large) is large


@pytest.mark.parametrize(
    ("deviation", "worst"),
    [
        (0.0 * X, "none"),
        (1.6 * np.tile([1.0, -1.0], N // 2), "neighbours"),
        (1.2 * np.repeat(np.tile([1.0, -1.0], N // 12), 6), "neighbours"),
        (7.0 * (np.arange(N) == 30), "outlier"),
        (-7.0 * (np.arange(N) == 30), "outlier"),
        (1.5 * np.random.default_rng(8).standard_normal(N), "chi-square"),
    ],
    ids=["noise", "alternating", "alike", "one high", "one low", "all larger"],
)
def test_residuals_are_looked_at_from_both_sides(deviation: Array, worst: str) -> None:
    noise = 0.6 * np.random.default_rng(2).standard_normal(N)
    found = criticise(solved(noise + deviation), [])
    assert (found.p_value < 1e-3) == (worst != "none")
    if worst != "none":
        assert found.worst == worst


class Folded(Level):
    """Data that tell the size of the level alone, so that a model may be on either side.

    As those of a fringe do of u and θ.
    """

    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        return np.asarray(
            self.data
            - np.abs(apply("placement", np.full(len(self.data), base["level"]), effects, values))
        )

    def equivalent_solutions(self, base: dict[str, float]) -> list[dict[str, float]]:
        return [{"level": -base["level"]}]


@pytest.mark.parametrize(
    ("low", "gains"), [(-HALF, (True,)), (0.0, (False, True))], ids=["either sign", "one sign"]
)
def test_an_effect_is_looked_at_from_the_other_side_where_it_does_something_else_there(
    low: float, gains: tuple[bool, ...]
) -> None:
    def act(value: Array, values: Values) -> Array:
        return np.asarray(value + values["size"] * X)

    effect = Effect(
        "slope", "", (ParameterSpec("size", "1", low, HALF),), {"placement": act}, "", "", ""
    )
    base_model = Folded(10 - 2 * X + np.random.default_rng(6).standard_normal(N), BLOCKS, HALF)
    mine = [
        test
        for test in score_tests(fit(ExtendedModel(base_model), np.array([8.0])), [effect])
        if test.effect is effect
    ]
    # On the far side the same change needs the other sign.
    assert tuple(test.gain > 10 for test in mine) == gains
    assert mine[-1].values["size"] == pytest.approx(-2 if low < 0 else 2, abs=0.8)


def test_an_effect_that_jumps_is_seen_as_its_jump_and_leaves_the_steps_of_other_shapes_alone() -> (
    None
):
    """As where a particle, however light, lets two modes exchange labels.

    In half of the places here, in long runs of trials.
    """

    def act(value: Array, values: Values) -> Array:
        jumps = 1e3 * (values["mass"] > 0) * np.sign(X) if values["place"] < 0.9 else 0.0
        return np.asarray(value + values["mass"] * np.cos(np.pi * X) + jumps)

    specs = (
        ParameterSpec("mass", "1", 0.0, HALF),
        ParameterSpec("place", "1", 0.0, 1.0, strength=False),
    )
    effect = Effect("particle", "", specs, {"placement": act}, "", "", "")
    mine = [
        test
        for test in score_tests(solved(np.random.default_rng(5).standard_normal(N)), [effect])
        if test.effect is effect
    ]
    assert len(mine) == 128
    cosine = np.cos(np.pi * X) - np.mean(np.cos(np.pi * X))
    for test in mine:
        expected = np.sign(X) if test.values["place"] < 0.9 else cosine
        assert abs(test.basis[0] @ expected) / np.linalg.norm(expected) == pytest.approx(
            1, abs=1e-6
        )


def test_an_effect_that_leads_to_another_summation_is_seen_without_its_rounding() -> None:
    """As an overtone of the motion, with which a clipped period is summed at other samples."""

    def act(value: Array, values: Values) -> Array:
        rounding = 0.05 * np.cos(7 * np.pi * X)
        return np.asarray(value + values["size"] * np.cos(np.pi * X) + rounding)

    spec = ParameterSpec("size", "1", -HALF, HALF)
    effect = Effect("overtone", "", (spec,), {"placement": act}, "", "", "")
    data = np.cos(np.pi * X) + 0.3 * np.random.default_rng(5).standard_normal(N)
    (mine,) = (test for test in score_tests(solved(data), [effect]) if test.effect is effect)
    assert mine.values["size"] == pytest.approx(1.0, abs=0.2)
    assert mine.gain == pytest.approx(solved(data).chi2 - solved(data, effect).chi2, rel=0.05)


def test_evidence_is_the_integral_of_likelihood_times_prior() -> None:
    data = 1.5 * np.cos(np.pi * (X + 1) / 2) + np.random.default_rng(3).standard_normal(N)
    with_it = solved(data, WAVES[0])
    without = solved(data)
    level = np.linspace(-2, 2, 401)
    size = np.linspace(-1, 4, 801)
    shape = np.cos(np.pi * (X + 1) / 2)
    left = data[:, None, None] - level[:, None] - size * shape[:, None, None]
    chi2 = np.sum(left**2, axis=0)
    # Half of a strength's prior is uniform over its range, half uniform in its logarithm over the
    # decades, of both signs. Nothing is left of the likelihood near zero, where that has no end.
    prior = 0.5 / (2 * HALF) + 0.5 / (2 * np.maximum(np.abs(size), 0.1) * np.log(DECADES))
    both = np.log(
        np.trapezoid(np.trapezoid(np.exp(-chi2 / 2) / (2 * HALF), level, axis=0) * prior, size)
    )
    alone = np.log(
        np.trapezoid(np.exp(-np.sum((data[:, None] - level) ** 2, axis=0) / 2) / (2 * HALF), level)
    )
    assert with_it.log_evidence == pytest.approx(both, abs=0.03)
    assert without.log_evidence == pytest.approx(alone, abs=0.01)


def test_unseen_data_are_predicted_by_the_others_alone() -> None:
    data = np.random.default_rng(4).standard_normal(N) + 2 * X**3
    found = solved(data, WAVES[0])
    rows = np.column_stack([np.ones(N), np.cos(np.pi * (X + 1) / 2)])
    hat = rows @ np.linalg.inv(rows.T @ rows) @ rows.T
    left = data - hat @ data
    # Leaving out a block b of a straight fit: (1 − H_bb)⁻¹ r_b.
    apart = [
        np.linalg.solve(np.eye(N // 4) - hat[np.ix_(b, b)], left[b])
        for b in np.arange(N).reshape(4, -1)
    ]
    assert found.cross_validation.chi2_reduced == pytest.approx(
        float(np.mean(np.concatenate(apart) ** 2)), rel=1e-3
    )
    assert found.cross_validation.chi2_reduced > 1.05 * float(np.mean(left**2))


def judged(base_p: float, *tried: tuple[Candidate, float]) -> str:
    """Verdict on a base model and tried candidates, each with its p-value."""
    noise = np.random.default_rng(5).standard_normal(N)
    base = Candidate(solved(noise + 3 * np.cos(np.pi * (X + 1) / 2)), base_p, "chi-square", ())
    return judge([base, *(replace(candidate, p_value=p) for candidate, p in tried)]).verdict


def test_a_cause_is_said_to_explain_only_what_it_leaves_nothing_of() -> None:
    noise = np.random.default_rng(5).standard_normal(N)
    data = noise + 3 * np.cos(np.pi * (X + 1) / 2)
    right = Candidate(solved(data, WAVES[0]), 0.5, "chi-square", ())
    wrong = Candidate(solved(data, WAVES[1]), 0.5, "chi-square", ())
    assert judged(0.5, (right, 0.5)) == "adequate"
    assert judged(1e-9, (right, 0.5), (wrong, 1e-6)) == "explained"
    assert judged(1e-9, (right, 1e-6), (wrong, 1e-6)) == "explained in part"
    assert judged(1e-9, (wrong, 1e-6)) == "unexplained"
    assert judged(1e-9) == "unexplained"


def test_two_causes_that_do_as_well_are_a_tie_told_with_both() -> None:
    noise = np.random.default_rng(5).standard_normal(N)
    data = noise + 3 * np.cos(np.pi * (X + 1) / 2)
    twin = replace(WAVES[0], name="twin")
    base = Candidate(solved(data), 1e-9, "chi-square", ())
    found = judge(
        [base, *(Candidate(solved(data, e), 0.5, "chi-square", ()) for e in (WAVES[0], twin))]
    )
    assert found.verdict == "ambiguous"
    assert {found.chosen.names, *(c.names for c in found.rivals)} == {("wave1",), ("twin",)}
    assert all(share < THRESHOLDS.named_alone for share in found.share.values())


def test_effects_need_what_the_measurement_must_have_recorded() -> None:
    needy = replace(WAVES[0], needs=("laser_power",))
    assert level(np.zeros(N)).usable_effects([needy, WAVES[1]]) == [WAVES[1]]


def test_effects_run_in_the_order_of_the_list_and_a_stage_is_turned_before_it_is_stretched() -> (
    None
):
    turn = library()["stage_rotation"]
    scale = library()["stage_scale"]
    values = [{"angle": 0.3}, {"stretch_x": 0.1, "stretch_y": -0.1}]
    here = Placement(np.array([1.0]), np.array([2.0]))
    found = apply("placement", here, [turn, scale], values)
    c = np.cos(0.3)
    s = np.sin(0.3)
    np.testing.assert_allclose(
        [found.x[0], found.y[0]], [1.1 * (c + 2 * s), 0.9 * (2 * c - s)], rtol=1e-14
    )
    assert found.x[0] != apply("placement", here, [scale, turn], values[::-1]).x[0]


def test_the_normal_tail_of_an_outlier_counts_every_datum() -> None:
    found = criticise(solved(np.where(np.arange(N) == 20, 6.5, 0.0)), [])
    size = np.abs(found.result.residuals).max() * np.sqrt(N / found.result.degrees)
    assert found.worst == "outlier"
    assert found.p_value == pytest.approx(4 * N * 2 * float(ndtr(-size)), rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("anisotropy", [-1.4e-3, 1.4e-3])
def test_modes_without_labels_are_the_lowest_even_where_a_pair_is_cut_in_half(
    anisotropy: float,
) -> None:
    film = SimulatedFilm(load("hexagon-278um"), 48)
    spectrum = measurement.spectrum(np.sort(film.modes.frequency[:11]), np.full(11, 1.0))
    base_model = pose_spectrum(spectrum, film)
    base = dict(zip((spec.name for spec in base_model.base), base_model.start, strict=True))
    uneven = [library()["stress_anisotropy"]]
    left = base_model.residuals(uneven, base, [{"anisotropy": anisotropy}])[:11]
    solved = base_model._solved(uneven, base, [{"anisotropy": anisotropy}]).frequency
    np.testing.assert_allclose(base_model.frequency - left, np.sort(solved)[:11], rtol=1e-12)


def test_sets_fitted_again_come_with_what_was_tried_of_fewer_causes() -> None:
    """Else nothing would tell what each cause of the likeliest sets is worth."""
    five = sum(3.0 * np.cos(np.pi * n * (X + 1) / 2) for n in range(1, 6))
    data = five + np.random.default_rng(4).standard_normal(N)
    found = search(level(data), WAVES)
    tried = {candidate.names for candidate in found}
    ranked = sorted(found, key=lambda candidate: -candidate.weight)
    assert len(ranked) > THRESHOLDS.most_refitted + len(WAVES)
    again = {candidate.names for candidate in refitted(level(data), WAVES, found)}
    for candidate in ranked[: THRESHOLDS.most_refitted]:
        fewer = {names for names in tried if set(names) <= set(candidate.names)}
        assert fewer <= again
