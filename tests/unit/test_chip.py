"""Chips of many devices: the hierarchy, outliers, and the causes of devices that deviate."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, norm

from femnl.chip import fit_chip
from femnl.chip.causes import _other_design
from femnl.chip.fit import entries_of
from femnl.chip.hierarchy import MEAN_SD, hierarchy
from femnl.chip.members import Chip, Member, Number
from femnl.chip.mixture import Mixture
from femnl.chip.outliers import _log_posterior, clean, log_anywhere
from femnl.chip.values import LEAST_SD, Values
from femnl.chip.words import chance
from femnl.core.errors import FemnlError
from femnl.report.chip import write_chip
from tests.blind import chips

SEED = 20261124


def values(count: int = 14, slope: float = 0.0, modes: int = 1, more: int = 0) -> Values:
    """Devices of two designs at random places; slope: of ln f along x; more: added to the seed."""
    spread = 1e-3
    rng = np.random.default_rng(SEED + more)
    place = rng.normal(size=(count, 2))
    device = np.repeat(np.arange(count), modes)
    design = np.arange(count) % 2
    group = modes * np.repeat(design, modes) + np.tile(np.arange(modes), count)
    shift = np.repeat(rng.normal(0, spread, count) + slope * place[:, 0], modes)
    y = 11.0 + 0.7 * group + shift + rng.normal(0, 0.2 * spread, modes * count)
    return Values(y, np.full(len(y), 1e-5), device, group, np.repeat(place, modes, axis=0))


def test_the_likelihood_is_that_of_a_normal_distribution() -> None:
    model = hierarchy(values(modes=2))
    v = model.values
    scales = model.scales
    same = v.device[:, None] == v.device[None]
    alike = v.group[:, None] == v.group[None]
    for k in (0, 40, len(scales.field) - 1):
        covariance = (MEAN_SD * model.unit) ** 2 * alike + np.diag(v.sd**2)
        terms = model.terms(v.place, scales.field[k])
        covariance = covariance + scales.amplitude[k] ** 2 * terms @ terms.T
        covariance += scales.spread[k] ** 2 * same + scales.mode_spread[k] ** 2 * np.eye(len(v.y))
        expected = multivariate_normal(model.reference(v), covariance).logpdf(v.y)
        assert model.solved.log_likelihoods[k] == pytest.approx(expected, rel=1e-6)
    evidence = logsumexp(model.solved.log_likelihoods + scales.log_prior)
    assert model.log_evidence == pytest.approx(evidence)
    forms = np.array(scales.field)
    for form in ("none", "plane", "bowl"):
        assert np.exp(scales.log_prior[forms == form]).sum() == pytest.approx(1 / 3)


def test_a_prediction_is_the_conditional_of_a_normal_distribution() -> None:
    """For every kind of scales: mean and variance of new entries, given those of all others."""
    v = values(modes=2, slope=2e-3)
    own = v.device == 3
    model = hierarchy(v.without(frozenset([3])))
    predicted = model.predict(v.only(own))
    same = v.device[:, None] == v.device[None]
    alike = v.group[:, None] == v.group[None]
    scales = model.scales
    off = v.y - model.reference(v)
    for k in (0, 40, len(scales.field) - 1):
        terms = model.terms(v.place, scales.field[k])
        covariance = (MEAN_SD * model.unit) ** 2 * alike + np.diag(v.sd**2)
        covariance = covariance + scales.amplitude[k] ** 2 * terms @ terms.T
        covariance += scales.spread[k] ** 2 * same + scales.mode_spread[k] ** 2 * np.eye(len(v.y))
        gain = covariance[np.ix_(own, ~own)] @ np.linalg.inv(covariance[np.ix_(~own, ~own)])
        mean = gain @ off[~own]
        # By the inverse: a difference of covariances would cancel six digits
        variance = np.linalg.inv(np.linalg.inv(covariance)[np.ix_(own, own)])
        given = predicted.means[k] - model.reference(v.only(own))
        assert given == pytest.approx(mean, rel=1e-5, abs=1e-9)
        assert predicted.variances[k] == pytest.approx(np.diag(variance), rel=1e-6)
        assert scales.spread[k] > 0
    assert scales.mode_spread[-1] > 0


@pytest.mark.parametrize("modes", [1, 2])
def test_a_device_left_out_is_predicted_as_by_a_model_that_never_saw_it(modes: int) -> None:
    v = values(modes=modes, slope=2e-3)
    whole = hierarchy(v).left_out
    for device in (0, 5):
        own = v.device == device
        rest = hierarchy(v.without(frozenset([device])), v.unit)
        # On the same terms of the places and counted from the same
        rest = replace(rest, centre=hierarchy(v).centre, scale=hierarchy(v).scale)
        other = rest.predict(v.only(own))
        assert whole.mean[own] == pytest.approx(other.mean, abs=0.02 * v.unit)
        assert whole.sd[own] == pytest.approx(other.sd, rel=0.02)


def test_the_spread_of_a_mixture_is_that_of_its_parts_and_between_them() -> None:
    """Two normals of equal weight, 2d apart: σ² + d², also far from 0."""
    apart = 3e-7
    sd = 4e-7
    ones = np.ones((2, 1))
    means = 14.0 + apart * np.array([[-1.0], [1.0]])
    mixture = Mixture(0.5 * ones, means, sd**2 * ones)
    assert mixture.mean == pytest.approx(14.0, abs=1e-12)
    assert mixture.sd == pytest.approx(5e-7, rel=1e-6)


def test_devices_that_are_all_equal_have_an_error_of_measurement() -> None:
    v = values(8)
    equal = replace(v, y=np.asarray(11.0 + 0.7 * v.group, float), sd=np.full_like(v.sd, 1e-7))
    # Three others of the design give its mean, and a spread below the error cannot be excluded
    sd = hierarchy(equal).left_out.sd
    assert np.all(sd > np.sqrt(1 + 1 / 3) * 0.99e-7)
    assert np.all(sd < 2e-7)


def test_a_slope_is_found_and_none_where_there_is_none() -> None:
    flat = [hierarchy(values(more=k)).probability("none") for k in range(10)]
    assert np.median(flat) > 0.5
    assert min(flat) > 0.05
    assert hierarchy(values(slope=3e-3)).probability("none") < 1e-3


@pytest.mark.parametrize("modes", [1, pytest.param(3, marks=pytest.mark.slow)])
def test_predictions_are_as_wrong_as_they_say_with_one_mode_and_with_several(modes: int) -> None:
    """Modes that differ by a fifth of the spread must not hide how far devices scatter."""
    off = []
    for k in range(20):
        v = values(20, modes=modes, more=k)
        predicted = hierarchy(v).left_out
        off.append((v.y - predicted.mean) / predicted.sd)
    assert np.std(off) == pytest.approx(1.0, abs=0.12)
    assert np.mean(np.abs(off) < 1) == pytest.approx(0.69, abs=0.06)


def test_a_bowl_is_told_from_a_plane() -> None:
    v = values(30)
    bowl = 4e-3 * (v.place**2).sum(axis=1)
    assert hierarchy(replace(v, y=v.y + bowl)).probability("bowl") > 0.95


def test_the_evidence_does_not_depend_on_the_axes_of_the_places() -> None:
    v = values(20)
    v = replace(v, y=v.y + 3e-3 * v.place[:, 0] * v.place[:, 1])
    turn = np.pi / 5
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    turned = replace(v, place=7.0 * v.place @ rotation + 3.0)
    assert hierarchy(turned).log_evidence == pytest.approx(hierarchy(v).log_evidence, abs=1e-6)


def test_without_places_no_variation_is_sought() -> None:
    v = values()
    assert hierarchy(replace(v, place=np.full_like(v.place, np.nan))).fields == ("none",)


@pytest.mark.parametrize("odd", [(), (3,), (3, 8)])
def test_outliers_are_found_even_where_two_hide_each_other(odd: tuple[int, ...]) -> None:
    v = values(20)
    y = v.y.copy()
    for k in odd:
        y[v.device == k] += 1.5e-2
    assert set(clean(replace(v, y=y)).outliers) == set(odd)


@pytest.mark.parametrize(("count", "sign"), [(12, 1.0), (10, -1.0)])
def test_two_outliers_that_hide_each_other_are_found_as_a_pair(count: int, sign: float) -> None:
    """Neither is probable alone: with one as an outlier, the other still widens the spread."""
    v = values(count, more=1)
    y = v.y.copy()
    y[v.device == 3] += 1e-2
    y[v.device == 5] += sign * 1e-2
    v = replace(v, y=y)
    alone = [_log_posterior(v, frozenset([d]), count, v.unit) for d in (3, 5)]
    assert max(alone) < _log_posterior(v, frozenset(), count, v.unit)
    assert set(clean(v).outliers) == {3, 5}


def test_a_device_that_deviates_alike_in_all_modes_is_found_as_with_one_mode() -> None:
    """Its modes share one shift, which has to be paid for once."""
    for modes in (1, 3):
        v = values(20, modes=modes)
        y = v.y + 8e-3 * (v.device == 4)
        found = clean(replace(v, y=y)).outliers
        assert set(found) == {4}
        assert found[4] > 0.99


def test_the_joint_density_of_a_device_is_that_of_a_normal_distribution() -> None:
    """Given every scale: p(y of both modes) = p(y of all)/p(y of the others), 10 units wider."""
    v = values(modes=2, slope=2e-3)
    own = v.device == 3
    model = hierarchy(v.without(frozenset([3])))
    wider = 10 * model.unit
    same = v.device[:, None] == v.device[None]
    alike = v.group[:, None] == v.group[None]
    scales = model.scales
    off = v.y - model.reference(v)
    each = []
    for k, field in enumerate(scales.field):
        terms = model.terms(v.place, field)
        covariance = (MEAN_SD * model.unit) ** 2 * alike + np.diag(v.sd**2)
        covariance = covariance + scales.amplitude[k] ** 2 * terms @ terms.T
        covariance += scales.spread[k] ** 2 * same + scales.mode_spread[k] ** 2 * np.eye(len(v.y))
        covariance[np.ix_(own, own)] += wider**2
        rest = covariance[np.ix_(~own, ~own)]
        each.append(
            multivariate_normal(cov=covariance).logpdf(off)
            - multivariate_normal(cov=rest).logpdf(off[~own])
        )
    weights = np.log(np.maximum(model.weights, 1e-300))
    expected = logsumexp(weights + np.array(each))
    assert model.log_density(v.only(own), wider) == pytest.approx(expected, rel=1e-5)


def test_a_device_beyond_all_proportion_is_an_outlier_and_no_singular_matrix() -> None:
    v = values(modes=3)
    far = replace(v, y=np.where(v.device == 3, 138.0, 11.0), sd=np.full(len(v.y), LEAST_SD))
    assert set(clean(far.bounded()).outliers) == {3}


@pytest.mark.parametrize("share", [1e-5, 1e-4])
def test_an_error_that_is_lost_beside_the_scatter_changes_nothing(share: float) -> None:
    v = values(modes=2)
    exact = hierarchy(replace(v, sd=np.full(len(v.y), LEAST_SD)))
    bounded = hierarchy(replace(v, sd=np.full(len(v.y), share * v.unit)))
    assert bounded.log_evidence == pytest.approx(exact.log_evidence, abs=1e-4)
    np.testing.assert_allclose(
        bounded.left_out.mean, exact.left_out.mean, rtol=0, atol=1e-5 * v.unit
    )


def test_the_density_of_an_outlier_has_the_integral_one() -> None:
    v = values()
    model = hierarchy(v.without(frozenset([2])))
    own = v.only(v.device == 2)
    # Uniform in the angle of a Cauchy distribution: fine in the middle, and 200 units wide
    angle = np.linspace(-1.565, 1.565, 1401)
    y = own.y + 10 * v.unit * np.tan(angle)
    density = [np.exp(log_anywhere(model, replace(own, y=np.array([one])))) for one in y]
    assert trapezoid(density, y) == pytest.approx(1, rel=1e-3)


def test_the_probability_of_another_design_is_that_of_two_densities() -> None:
    """Bayes: 0.2 N(y | design b) against 0.8 times the density of an outlier of design a."""
    rng = np.random.default_rng(SEED)
    members = []
    for k in range(16):
        design = "ab"[k % 2]
        frequency = {"a": 1e5, "b": 1.5e5}[design] * np.exp(rng.normal(0, 1e-3))
        members.append(Member(str(k), design, (np.nan, np.nan), {"1": Number(frequency, 0.0)}))
    told = []
    for shift in (0.0, 3.8e-3):
        odd = Member("odd", "a", (np.nan, np.nan), {"1": Number(1.5e5 * np.exp(shift), 0.0)})
        chip = Chip("c", (*members, odd), {}, ())
        entries = entries_of(chip, {m.name: m.frequency for m in chip.members})
        cleaned = clean(entries.values)
        assert set(cleaned.outliers) == {16}
        own = entries.values.only(entries.values.device == 16)
        there = cleaned.model.predict(replace(own, group=np.array([1])))
        sd = np.sqrt(there.variances[:, 0])
        of_b = there.weights[:, 0] @ norm.pdf(own.y, there.means[:, 0], sd)
        anywhere = np.exp(log_anywhere(cleaned.model, own))
        design, probability = _other_design(entries, cleaned, "odd")
        expected = 0.2 * of_b / (0.2 * of_b + 0.8 * anywhere)
        told.append(probability)
        assert design == "b"
        assert probability == pytest.approx(expected, rel=1e-9)
    assert told[0] > 0.99
    assert 0.2 < told[1] < 0.99


@pytest.mark.slow
def test_simulated_chips_give_up_what_is_hidden_in_them() -> None:
    """Ten chips; `python -m tests.blind.chips` draws hundreds."""
    records = [chips.judge(SEED + k) for k in range(10)]
    rates = chips.score(records)
    assert rates["hidden device named"]["rate"] > 0.7
    assert rates["chip with nothing hidden: a device named"]["k"] <= 1
    assert rates["68 % intervals hold"]["rate"] == pytest.approx(0.68, abs=0.1)


def plain_chip(count: int = 12, shift: float = 0.0, seed: int = SEED) -> Chip:
    """Return a chip of one design on a grid, of frequencies alone; shift: of the last device."""
    rng = np.random.default_rng(seed)
    members = []
    for k in range(count):
        own = rng.normal(0, 1e-3) + (shift if k == count - 1 else 0.0)
        frequency = {"1": Number(1e6 * float(np.exp(own)), 1.0)}
        members.append(Member(str(k), "a", (k % 4, k // 4), frequency))
    return Chip("plain", tuple(members), {}, ())


def test_a_deviating_device_without_a_place_is_named() -> None:
    chip = plain_chip(shift=0.1)
    lost = replace(chip.members[-1], place=(np.nan, np.nan))
    fit = fit_chip(replace(chip, members=(*chip.members[:-1], lost)))
    assert [c.device for c in fit.causes] == ["11"]
    assert list(fit.frequency.fields) == ["none"]
    assert any("places: not known of all devices" in line for line in fit.notes)


def test_a_chip_without_quality_factors_has_frequencies_alone(tmp_path: Path) -> None:
    chip = plain_chip()
    without_places = tuple(replace(m, place=(np.nan, np.nan)) for m in chip.members)
    fit = fit_chip(replace(chip, members=without_places))
    assert fit.quality is None
    write_chip(fit, tmp_path / "study.toml", tmp_path)
    with (tmp_path / "devices.csv").open(encoding="utf-8", newline="") as file:
        assert {row["quantity"] for row in csv.DictReader(file)} == {"frequency"}
    text = (tmp_path / "chip.json").read_text(encoding="utf-8")
    numbers = json.loads(text, parse_constant=pytest.fail)
    assert numbers["frequency"]["devices"][0]["place"] == [None, None]
    assert "quality factor" not in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_devices_of_which_none_is_like_another_are_refused() -> None:
    chip = plain_chip(4)
    members = tuple(replace(m, design=m.name) for m in chip.members)
    with pytest.raises(FemnlError, match="no two devices share a design and a mode"):
        fit_chip(replace(chip, members=members))


def test_small_probabilities_are_told_as_small() -> None:
    assert [chance(p) for p in (3.26e-6, 1.2e-3, 0.1234, 1.0)] == [
        "< 0.1 %",
        "0.12 %",
        "12.3 %",
        "100 %",
    ]


def test_names_that_were_exchanged_are_told() -> None:
    members = []
    rng = np.random.default_rng(SEED)
    for k in range(16):
        design = "ab"[k % 2]
        frequency = {"a": 1e5, "b": 1.5e5}[design] * np.exp(rng.normal(0, 1e-3))
        told = {0: "b", 1: "a"}.get(k, design)
        members.append(Member(str(k), told, (k % 4, k // 4), {"1": Number(frequency, 0.0)}))
    found = {c.device: c for c in fit_chip(Chip("c", tuple(members), {}, ())).causes}
    assert {name: c.name for name, c in found.items()} == {"0": "mislabelled", "1": "mislabelled"}
    assert "that of design a" in found["0"].words


def test_a_lossy_device_is_told_from_one_with_another_frequency() -> None:
    rng = np.random.default_rng(SEED)
    members = []
    for k in range(20):
        loss = {4: -4.0, 11: -4.0, 15: 4.0}.get(k, 0.0) + rng.normal(0, 0.3)
        shift = {7: 0.03, 11: -0.03}.get(k, 0.0) + rng.normal(0, 1e-3)
        frequency = {"1": Number(1e5 * np.exp(shift), 0.1)}
        quality = {"1": Number(1e6 * np.exp(loss), 1e4)}
        members.append(Member(str(k), "a", (k % 5, k // 5), frequency, quality))
    fit = fit_chip(Chip("c", tuple(members), {}, ()))
    assert {c.device: c.name for c in fit.causes} == {
        "4": "lossy",
        "7": "other film or shape",
        "11": "damaged",
        "15": "loses less",
    }


@pytest.mark.parametrize("shift", [0.0, 0.01])
def test_a_mode_that_one_device_alone_has_says_nothing_of_it(shift: float) -> None:
    rng = np.random.default_rng(20261126)
    members = []
    for k in range(13):
        own = k == 12
        factor = np.exp(rng.normal(0, 3e-4) + (shift if own else 0))
        modes = {"1,1": 1e6, "3,1" if own else "1,3": 2.236e6}
        numbers = {mode: Number(float(f * factor), 10.0) for mode, f in modes.items()}
        members.append(Member(f"D{k}", "square", (np.nan, np.nan), numbers))
    found = fit_chip(Chip("one more mode", tuple(members), {}, ()))
    assert [cause.device for cause in found.causes] == (["D12"] if shift else [])
    if shift:
        assert "+1.0" in found.causes[0].words
    assert ("D12", "3,1") not in {(one.device, one.mode) for one in found.frequency.devices}
    assert any("D12 3,1" in note for note in found.notes)


def test_a_spread_far_below_the_gradient_is_found() -> None:
    """Devices that scatter by 0.01 % over a chip that varies by 8 %, one of them 0.1 % off."""
    rng = np.random.default_rng(3)
    place = np.array([(x, y) for x in range(5) for y in range(5)], float)
    y = 0.02 * place[:, 0] + 1e-4 * rng.standard_normal(25)
    y[7] -= 1e-3
    one = np.arange(25)
    found = clean(Values(y, np.full(25, 1e-6), one, np.zeros(25, int), place))
    assert list(found.outliers) == [7]
    spread, sd = found.model.spread()
    assert spread == pytest.approx(1e-4, abs=3 * sd)
    assert 1e-5 < sd < 4e-5
