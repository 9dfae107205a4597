"""Chips of many devices: the hierarchy, outliers, study files, and what a user sees."""

import csv
import json
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, norm

from femnl.chip import fit_chip, read_chip
from femnl.chip.causes import _other_design
from femnl.chip.film import Design, slackening
from femnl.chip.fit import entries_of
from femnl.chip.hierarchy import MEAN_SD, hierarchy
from femnl.chip.members import Chip, Member, Number
from femnl.chip.mixture import Mixture
from femnl.chip.outliers import _log_anywhere, _log_posterior, clean
from femnl.chip.readings import median_of
from femnl.chip.values import Values
from femnl.chip.words import chance
from femnl.cli._main import run
from femnl.core.errors import FemnlError
from femnl.device.geometry import load
from femnl.io import measurement
from femnl.observe.film import SimulatedFilm
from femnl.report.chip import write_chip
from tests.blind import chips

SEED = 20261124
DATA = Path(__file__).parents[3] / "shared" / "data"


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
        variance = covariance[np.ix_(own, own)] - gain @ covariance[np.ix_(~own, own)]
        given = predicted.means[k] - model.reference(v.only(own))
        assert given == pytest.approx(mean, rel=1e-5, abs=1e-9)
        # The difference of covariances cancels six digits
        assert predicted.variances[k] == pytest.approx(np.diag(variance), rel=1e-3)
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


@pytest.mark.parametrize("modes", [1, 3])
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


def test_the_density_of_an_outlier_has_the_integral_one() -> None:
    v = values()
    model = hierarchy(v.without(frozenset([2])))
    own = v.only(v.device == 2)
    # Uniform in the angle of a Cauchy distribution: fine in the middle, and 200 units wide
    angle = np.linspace(-1.565, 1.565, 1401)
    y = own.y + 10 * v.unit * np.tan(angle)
    density = [np.exp(_log_anywhere(model, replace(own, y=np.array([one])), v.unit)) for one in y]
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
        anywhere = np.exp(_log_anywhere(cleaned.model, own, cleaned.model.unit))
        design, probability = _other_design(entries, cleaned, "odd")
        expected = 0.2 * of_b / (0.2 * of_b + 0.8 * anywhere)
        told.append(probability)
        assert design == "b"
        assert probability == pytest.approx(expected, rel=1e-9)
    assert told[0] > 0.99
    assert 0.2 < told[1] < 0.99


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


def test_the_slackening_of_a_square_is_that_of_its_side() -> None:
    """−E/((1 − ν) σ L): both sides of length L move in by d, a strain of 2d/L in each direction."""
    model = load("square-270um")
    film = model.film
    side = model.outline.length
    expected = -film.young / ((1 - film.poisson) * film.stress * side)
    assert slackening(model) == pytest.approx(expected, rel=1e-12)
    # A circle of radius R has P/A = 2/R
    circle = load("circle")
    film = circle.film
    expected = -film.young / (4 * (1 - film.poisson) * film.stress) * 4 / circle.outline.length
    assert slackening(circle) == pytest.approx(expected, rel=1e-3)


def test_an_edge_is_linearised_about_where_it_is() -> None:
    """Value and slope of ½(1 − β) ln(1 + 2 s d e^{−2δ}), with the stress before release e^{2δ}σ."""
    design = Design(np.array([13.0, 14.0]), np.array([-2e6, -5e5]), np.array([0.03, 0.3]))
    moved = 25e-9
    offset = 0.07

    def exact(d: float) -> np.ndarray[Any, Any]:
        left = 1 + 2 * design.slackening * d * np.exp(-2 * offset)
        return np.asarray(design.base + 0.5 * (1 - design.bending) * np.log(left))

    base, columns = design.about(moved, offset)
    assert base + moved * columns[:, 0] == pytest.approx(exact(moved), rel=1e-12)
    step = 1e-12
    slope = (exact(moved + step) - exact(moved - step)) / (2 * step)
    assert columns[:, 0] == pytest.approx(slope, rel=1e-3)
    assert columns[:, 1] == pytest.approx([0.03, 0.3])


def test_a_change_of_stress_changes_frequencies_by_what_bending_leaves(tmp_path: Path) -> None:
    """∂ ln f/∂ ln σ = ½(1 − β), with β the part of the energy in bending, by two simulations."""
    text = load("square-270um").text.replace('side = "270 um"', 'side = "40 um"')
    films = []
    for stress in ("1101.5 MPa", "1112.5 MPa"):
        path = tmp_path / f"{stress[:6]}.toml"
        path.write_text(text.replace("1101.5 MPa", stress), encoding="utf-8")
        films.append(SimulatedFilm(load(str(path)), 3))
    ratio = films[1].modes.frequency[0] / films[0].modes.frequency[0]
    rise = films[1].model.film.stress / films[0].model.film.stress
    assert rise > 1.009
    share = films[0].bending_share[0]
    assert share > 0.03
    assert np.log(ratio) / np.log(rise) == pytest.approx(0.5 * (1 - share), rel=2e-3)


def sizes(folder: Path, inwards: float, sides: tuple[float, ...], bending: bool = True) -> Path:
    """Write a study of squares whose edges moved inwards.

    Frequencies are those of the clamped plate as a membrane smaller by ℓ on every side, under the
    tension that the strain 2d/L in both directions leaves.
    """
    rng = np.random.default_rng(SEED)
    text = load("square-270um").text
    film = tomllib.loads(text)["film"]
    assert (film["young"], film["thickness"]) == ("250 GPa", "183.75 nm")
    young, poisson, density, thickness, stress = 250e9, 0.23, 3100.0, 183.75e-9, 1101.5e6
    lines = ['name = "sizes"']
    for side in sides:
        name = f"square-{side:g}um"
        own = text.replace('side = "270 um"', f'side = "{side:g} um"')
        if not bending:
            own = own.replace("bending = true", "bending = false")
        (folder / f"{name}.toml").write_text(own.replace("square-270um", name), encoding="utf-8")
        lines.append(f'[design.{name}]\ngeometry = "{name}.toml"')
        for k in range(4):
            length = side * 1e-6
            left = stress - young / (1 - poisson) * 2 * inwards / length
            rigidity = young * thickness**3 / (12 * (1 - poisson**2))
            layer = np.sqrt(rigidity / (left * thickness)) if bending else 0.0
            shift = np.exp(rng.normal(0, 1e-3))
            modes = []
            for m, n in ((1, 1), (2, 2)):
                k2 = np.pi**2 * (m**2 + n**2) / (length - 2 * layer) ** 2
                omega = np.sqrt(left / density * (k2 + layer**2 * k2**2))
                modes.append(
                    f'{{mode = "{m},{n}", frequency = {omega * shift / (2 * np.pi):.2f}, '
                    f"frequency_sd = 10.0}}"
                )
            lines.append(f'[[device]]\nname = "{name}-{k}"\ndesign = "{name}"')
            lines.append(f"modes = [{', '.join(modes)}]")
    path = folder / "study.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def test_devices_of_other_sizes_prove_an_edge_that_moves_inwards(tmp_path: Path) -> None:
    fit = fit_chip(read_chip(sizes(tmp_path, 20e-9, (60, 150, 400))))
    assert fit.film is not None
    proved = sum(p for name, p in fit.film.causes.items() if "edge" in name)
    assert proved > 0.99
    edge = next(p for p in fit.film.parameters if "edge" in p.name)
    assert edge.value == pytest.approx(20e-9, abs=3 * edge.sd)
    assert edge.sd < 1.5e-9
    # Four devices of a spread of 0.1 % leave the means 0.05 %, and the closed form is as good
    assert max(abs(r) for r in fit.film.residuals.values()) < 1e-3


def test_an_edge_that_moves_is_found_of_membranes_without_bending(tmp_path: Path) -> None:
    fit = fit_chip(read_chip(sizes(tmp_path, 20e-9, (60, 150, 400), bending=False)))
    assert fit.film is not None
    assert set(fit.film.causes) == {"one film as simulated", "edge moves inwards"}
    assert fit.film.causes["edge moves inwards"] > 0.99
    edge = next(p for p in fit.film.parameters if "edge" in p.name)
    assert edge.value == pytest.approx(20e-9, abs=3 * edge.sd)


def test_devices_of_one_size_cannot_and_say_which_would(tmp_path: Path) -> None:
    fit = fit_chip(read_chip(sizes(tmp_path, 20e-9, (270,))))
    assert fit.film is not None
    assert fit.film.causes["one film as simulated"] > 0.1
    assert "a square of 50 µm" in fit.film.measure_next


STUDY = """
name = "chip"
[table]
file = "table.csv"
chip = "A-"
[positions]
pattern = "(?P<y>[0-9])(?P<x>[0-9])"
pitch = "2 mm"
"""
HEAD = "device,mode,frequency,quality_factor\n"


@pytest.mark.parametrize("count", [1, 2, 25])
def test_repeats_count_by_their_median_with_the_error_of_a_median(count: int) -> None:
    """Against 2000 draws of normal readings, one of which is stated with half of their scatter."""
    rng = np.random.default_rng(SEED)
    draws = 1e6 + rng.normal(0, 10.0, (2000, count))
    numbers = [median_of([(float(value), 5.0) for value in row]) for row in draws]
    assert [n.value for n in numbers] == pytest.approx(np.median(draws, axis=1))
    assert {n.repeats for n in numbers} == {count}
    told = float(np.sqrt(np.mean([n.sd**2 for n in numbers])))
    true = float(np.std(np.median(draws, axis=1)))
    # One reading has no scatter, so what is stated counts
    assert told == pytest.approx(5.0 if count == 1 else true, rel=0.1)


def test_one_wrong_reading_of_five_does_not_move_a_number() -> None:
    found = median_of([(v, 0.0) for v in (100.0, 101.0, 102.0, 103.0, 1e6)])
    assert found.value == 102.0
    assert found.sd == pytest.approx(1.4826 * np.sqrt(np.pi / 10))


def device(frequency: str = "1e6") -> str:
    """Return a [[device]] table for one device of one mode."""
    return f"\n[[device]]\nname = '51'\nmodes = [{{frequency = {frequency}}}]\n"


def study(folder: Path, text: str = STUDY, rows: str | None = None) -> Path:
    """Write a study with a table of twelve devices in a plane."""
    if rows is None:
        rng = np.random.default_rng(SEED)
        rows = HEAD + "".join(
            f"A-{y}{x},1,{1e6 * np.exp(4e-3 * x + rng.normal(0, 5e-4)):.2f},{rng.uniform(1, 2)}e6\n"
            for x in range(1, 5)
            for y in range(1, 4)
        )
    (folder / "table.csv").write_text(rows, encoding="utf-8")
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_table_of_a_chip_gives_its_gradient_per_metre(tmp_path: Path) -> None:
    fit = fit_chip(read_chip(study(tmp_path)))
    assert fit.frequency.fields["plane"] > 0.8
    assert fit.frequency.slope is not None
    x, y = fit.frequency.slope
    assert x.value == pytest.approx(2.0, abs=3 * x.sd)
    assert abs(y.value) < 3 * y.sd
    assert fit.frequency.left_out.error < 0.5 * fit.frequency.left_out.plain_error
    assert "none is stated" in fit.notes[0]


def test_the_command_writes_a_page_numbers_and_a_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert run(["chip", str(study(tmp_path)), "--out", str(out)]) == 0
    printed = capsys.readouterr()
    assert "slope along x" in printed.out
    assert "% by the mean of its design" in printed.err
    numbers = json.loads((out / "chip.json").read_text(encoding="utf-8"))
    assert numbers["femnl_chip"] == "1.0"
    assert len(numbers["frequency"]["devices"]) == 12
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "% a mm" in page
    assert "data:image/webp" in page
    assert "&lt; 0.1 %" in page
    with (out / "devices.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 24
    first = next(r for r in rows if (r["quantity"], r["device"]) == ("frequency", "31"))
    told = next(d for d in numbers["frequency"]["devices"] if d["device"] == "31")
    measured = (tmp_path / "table.csv").read_text(encoding="utf-8").split("A-31,1,")[1]
    assert float(first["value"]) == pytest.approx(float(measured.split(",")[0]))
    # 31: row 3, column 1 of a grid of 2 mm
    assert (float(first["x"]), float(first["y"])) == pytest.approx((2e-3, 6e-3))
    part = np.log(float(first["value"]) / float(first["predicted"]))
    assert float(first["log_ratio"]) == pytest.approx(part)
    assert float(first["sigma"]) == pytest.approx(part / float(first["sd"]))
    assert {key: first[key] for key in ("mode", "design")} == {"mode": "1", "design": "1"}
    assert float(first["sd"]) == told["sd"]


@pytest.mark.parametrize(
    ("text", "rows", "words"),
    [
        (STUDY.replace("[table]", "[tabel]"), None, "tabel: Extra inputs are not permitted"),
        (STUDY.replace('"A-"', '"B-"'), None, "0 devices; a chip has 4 to 2000"),
        (STUDY.replace("<x>", "<z>"), None, "it needs the groups"),
        (STUDY.replace("[0-9])(", "[a-z])("), None, "'11' does not match it"),
        (STUDY.replace("[0-9])(", "[7-9])?("), None, "device 11: y: '' is no finite number"),
        (STUDY + device() + "design = 'a'", None, "has no design; give one for every device"),
        (STUDY, "device,f\nA-11,1e6\n", "no column 'frequency'; it has device, f"),
        (STUDY, HEAD + "A-11,1,zero,1e6\n", "line 2: frequency: 'zero' is no finite number"),
        (STUDY, HEAD + "A-11,1,1e6,1e6\nA-12,1,-1e6,1e6\n", "line 3: frequency: -1e+06 is not"),
        (STUDY + "\n[design.a]\ngeometry = 'circle'", None, "no device is of this design"),
        ("name = 'x'\nname = 'y'", None, "is no TOML"),
        (STUDY + "\n[[device]]\nname = '11'\nposition = ['1 s', '2 m']", None, "position"),
        ("name = 'x'", None, "has no devices; add [table] or [[device]]"),
        (STUDY + 2 * device(), None, "two [[device]] tables have the name '51'"),
        (STUDY + device("nan"), None, "device.0.modes.0.frequency: nan is no finite number"),
        (STUDY + device("'nan Hz'"), None, "device 51: frequency: 'nan Hz' is not a quantity"),
        (STUDY + device("1e6, frequency_sd = -1.0"), None, "frequency_sd: -1 Hz is below zero"),
        (
            STUDY + device("1e6, quality_factor = 1e6, quality_factor_sd = -1.0"),
            None,
            "quality_factor_sd: it is below zero",
        ),
        (STUDY, "device,frequency,frequency\nA-11,1e6,2e6\n", "two columns 'frequency'"),
        (STUDY, HEAD + "A-11,1,1e6\n", "line 2: has not as many fields as the head (4)"),
        (STUDY, HEAD + "A-11,1,1e6,1e6,1\n", "line 2: has not as many fields as the head (4)"),
    ],
)
def test_a_study_that_cannot_be_used_gets_one_line(
    text: str, rows: str | None, words: str, tmp_path: Path
) -> None:
    with pytest.raises(FemnlError) as error:
        read_chip(study(tmp_path, text, rows))
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_an_unknown_geometry_gets_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = ["name = 'c'", "[design.a]", "geometry = 'nosuch'"]
    lines += [
        f"[[device]]\nname = '{k}'\ndesign = 'a'\nmodes = [{{frequency = 1.0{k}e6}}]"
        for k in range(5)
    ]
    path = tmp_path / "study.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    assert run(["chip", str(path)]) != 0
    told = capsys.readouterr().err.strip()
    assert "nosuch: neither a shipped geometry nor a file" in told
    assert "Traceback" not in told


def test_errors_of_quality_factors_are_read_and_counted(tmp_path: Path) -> None:
    head = "device,design,frequency,quality_factor,quality_factor_sd\n"
    rows = head + "".join(f"A-1{k},a,1e6,2e6,4e4\n" for k in range(4))
    more = "\n[[device]]\nname = '14'\ndesign = 'a'\nmodes = [{frequency = 1e6, "
    more += "quality_factor = 1e6, quality_factor_sd = 5e4}]\n"
    chip = read_chip(study(tmp_path, STUDY + more, rows))
    assert [m.quality["1"].sd for m in chip.members] == [4e4] * 4 + [5e4]
    sd = entries_of(chip, {m.name: m.quality for m in chip.members}).values.sd
    # Of the logarithm
    assert sd == pytest.approx([0.02] * 4 + [0.05])


def test_a_device_adds_to_its_row_of_the_table(tmp_path: Path) -> None:
    rows = "device,design,frequency\n" + "".join(f"A-1{k},a,1e6\n" for k in range(4))
    more = "\n[[device]]\nname = '13'\nmodes = [{mode = '2', frequency = 2e6}]\n"
    members = read_chip(study(tmp_path, STUDY + more, rows)).members
    assert [m.design for m in members] == ["a"] * 4
    assert set(members[3].frequency) == {"1", "2"}


@pytest.mark.skipif(not DATA.exists(), reason="../shared/data is not there")
def test_a_real_chip_with_a_gradient_is_predicted_better_than_by_its_mean(tmp_path: Path) -> None:
    """PSE2-41, 16 membranes on a grid of 4 × 4 (qpit/Ringdown-Processor)."""
    text = STUDY.replace("table.csv", str(DATA / "decays.csv")).replace("A-", "PSE2-41-")
    columns = '[table.columns]\ndevice = "sample"\nfrequency = "frequency_Hz"\n'
    path = tmp_path / "study.toml"
    path.write_text(text.replace("[positions]", f"{columns}[positions]"), encoding="utf-8")
    fit = fit_chip(read_chip(path))
    assert fit.frequency.varies > 0.999
    assert fit.frequency.left_out.error < 0.25 * fit.frequency.left_out.plain_error


def test_a_file_gives_the_modes_of_a_device_by_spectrum_response_and_decay(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(SEED)
    f = np.linspace(0.9999e6, 1.0001e6, 81)
    # Q = 50 000 at 1 MHz
    clean = 1e6 * 20.0 / (1e12 - f**2 + 20j * f) * 1e-3
    volts = clean + 1e-6 * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size))
    time = np.linspace(0, 2, 400)
    # A decay of 60 dB in a second: γ = 6 ln 10 in energy
    power = 10 * np.log10(1e-4 * np.exp(-6 * np.log(10) * time) + 1e-9)
    groups = {
        "spectrum": measurement.spectrum([1.5e6, 2.0e6], [5.0, 5.0], label=["1,1", "2,2"]),
        "response": measurement.response(
            f[None], volts[None], drive=[1.0], noise_sd=1e-6, mode="a"
        ),
        "decay": measurement.decay(
            time=time,
            power=power + 0.1 * rng.standard_normal(time.size),
            attributes={"mode": "b", "frequency": 1e6},
        ),
    }
    path = study(tmp_path)
    measurement.write(measurement.bundle(groups), tmp_path / "m.nc")
    path.write_text(STUDY + "\n[[device]]\nname = '44'\nmeasurement = 'm.nc'\n", encoding="utf-8")
    found = next(m for m in read_chip(path).members if m.name == "44")
    assert set(found.frequency) == {"1,1", "2,2", "a", "b"}
    assert found.frequency["a"].value == pytest.approx(1e6, abs=1)
    assert found.quality["a"].value == pytest.approx(5e4, rel=0.01)
    assert found.quality["b"].value == pytest.approx(2e6 * np.pi / (6 * np.log(10)), rel=0.02)
