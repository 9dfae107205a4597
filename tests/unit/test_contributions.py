"""What each named cause changes of every datum: it adds up, and it is what was put in."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from femnl.core.comparison import Comparison, Curve, Curves, Images
from femnl.core.contributions import Account, Contributions, contributed
from femnl.core.diagnosis import Diagnosis
from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.errors import ParameterError
from femnl.core.readout import Array
from femnl.diagnose import diagnose, record, write
from femnl.diagnose.candidate import Candidate
from femnl.diagnose.contributions import contributions
from femnl.diagnose.posing import pose
from femnl.fits.least_squares import fit
from femnl.io import measurement
from femnl.observe.extended import ExtendedModel
from femnl.observe.model import MeasurementModel, Named
from femnl.observe.noisy import FoundNoise, with_noise
from femnl.pipeline import measured_device
from femnl.plot.contributions import contributions_figure
from femnl.report.diagnosis import write_diagnosis
from tests.blind.lab import Case, make
from tests.unit.test_noisy_model import BLOCKS, Line, N

PLACE = np.linspace(-1, 1, N)
LEVEL = 3.0
SHAPE = np.sin(7 * PLACE)


class Drawn(Line):
    """A line that can be drawn."""

    def compare(self, models: Sequence[Named]) -> tuple[Comparison, ...]:
        left = [self.residuals(effects, base, values) for _, effects, base, values in models]
        curve = Curve("one", PLACE, self.data, np.ones(N), self.data - np.stack(left))
        names = tuple(name for name, *_ in models)
        return (Curves("line", "place", "m", "level", "V", names, (curve,)),)


def effect(name: str, act: Callable[[Array, float], Array], strength: bool = True) -> Effect:
    """Return an effect of one parameter, which may be no strength."""

    def change(value: Array, values: Values) -> Array:
        return act(value, values["size"])

    size = ParameterSpec("size", "1", -50, 50, strength=strength)
    return Effect(name, "", (size,), {"placement": change}, "", "", "")


ADDED = effect("added", lambda value, size: value + size * SHAPE)
SCALED = effect("scaled", lambda value, size: value * (1 + size))
SHAPED = effect("shaped", lambda value, size: value + np.cos(size * PLACE), strength=False)


def fitted(model: MeasurementModel, effects: Sequence[Effect], start: Sequence[float]) -> Candidate:
    extended = ExtendedModel(model, tuple(effects))
    return Candidate(fit(extended, np.array([LEVEL, *start])), 1.0, "", None)


def added_up(account: Account) -> Array:
    causes = np.sum([cause.values for cause in account.causes], axis=0)
    return np.asarray(causes + account.interaction.values + account.remainder.values)


def test_one_known_cause_changes_what_was_put_in_and_does_not_interact() -> None:
    data = LEVEL + 5 * SHAPE
    model = Drawn(data, BLOCKS, 50.0)
    found = contributions(fitted(model, [ADDED], [4.0]), [fitted(model, [], [])])
    (account,) = found.accounts
    (cause,) = account.causes
    np.testing.assert_allclose(cause.values, 5 * SHAPE, atol=1e-6)
    np.testing.assert_allclose(account.deviation.values, data - LEVEL, atol=1e-6)
    assert not account.interaction.values.any()
    assert account.interaction_part == 0
    np.testing.assert_allclose(added_up(account), account.deviation.values, rtol=0, atol=1e-13)
    worst = int(np.argmax(np.abs(SHAPE)))
    assert cause.largest == pytest.approx(5 * SHAPE[worst], abs=1e-6)
    assert cause.where == f"datum {worst + 1}"
    assert cause.rms == pytest.approx(5 * np.sqrt(np.mean(SHAPE**2)), abs=1e-6)
    assert found.against == "the fitted model with all causes at zero"


def interacting() -> tuple[Drawn, Contributions]:
    # (level + a shape)(1 + s), with noise that no cause takes up
    noise = np.random.default_rng(1).standard_normal(N)
    model = Drawn((LEVEL + 30 * SHAPE) * 1.4 + noise, BLOCKS, 50.0)
    # Level and scale are one number without a bound on one of them: the level is known
    model.base = (ParameterSpec("level", "1", LEVEL - 1e-6, LEVEL + 1e-6),)
    best = fitted(model, [ADDED, SCALED], [29.0, 0.3])
    return model, contributions(best, [fitted(model, [], [])])


def test_what_two_causes_do_together_is_told_as_their_interaction() -> None:
    _, found = interacting()
    assert found.causes == ("added", "scaled")
    (account,) = found.accounts
    added, scaled = account.causes
    np.testing.assert_allclose(added_up(account), account.deviation.values, rtol=0, atol=1e-12)
    # (L + a)(1 + s): without a it lacks a(1 + s), without s it lacks s(L + a), without both
    # a(1 + s) + sL, which is less than the sum by s a
    size = 30 * SHAPE
    np.testing.assert_allclose(added.values, 1.4 * size, atol=0.8)
    np.testing.assert_allclose(scaled.values, 0.4 * (LEVEL + size), atol=0.8)
    np.testing.assert_allclose(account.interaction.values, -0.4 * size, atol=0.8)
    whole = np.abs(1.4 * size + 0.4 * LEVEL).max()
    assert account.interaction_part == pytest.approx(0.4 * np.abs(size).max() / whole, abs=0.03)
    assert f"interaction: {100 * account.interaction_part:.3g} %" in found.summary()


def test_a_cause_without_strengths_counts_from_the_best_fit_without_it() -> None:
    model = Drawn(LEVEL + np.cos(3 * PLACE) + 5 * SHAPE, BLOCKS, 50.0)
    base = fitted(model, [], [])
    alone = contributions(fitted(model, [SHAPED], [3.1]), [base])
    assert alone.against == "the best fit without shaped"
    # The best constant is the mean
    np.testing.assert_allclose(
        alone.accounts[0].deviation.values, model.data - model.data.mean(), atol=1e-6
    )
    both = contributions(fitted(model, [ADDED, SHAPED], [4.9, 3.1]), [base])
    assert both.against == "the best fit without shaped, the other causes at zero"
    (account,) = both.accounts
    np.testing.assert_allclose(added_up(account), account.deviation.values, rtol=0, atol=1e-12)
    # Without it: a constant and the sine, by linear least squares
    columns = np.stack([np.ones(N), SHAPE], axis=1)
    coefficients = np.linalg.lstsq(columns, model.data, rcond=None)[0]
    without = columns @ coefficients
    added, shaped = account.causes
    np.testing.assert_allclose(added.values, 5 * SHAPE, atol=1e-5)
    np.testing.assert_allclose(shaped.values, model.data - without, atol=1e-5)
    np.testing.assert_allclose(
        account.deviation.values, model.data - coefficients[0], rtol=0, atol=1e-5
    )


def test_glitches_are_listed_and_do_not_count() -> None:
    data = LEVEL + 5 * SHAPE
    data[17] += 400
    noise = FoundNoise((17,), 2.0, 0.3)
    model = with_noise(Drawn(data, BLOCKS, 50.0), noise)
    found = contributions(fitted(model, [ADDED], [4.0]), [fitted(model, [], [])])
    (account,) = found.accounts
    # White residuals would not add up to the data: those of all data do
    np.testing.assert_allclose(added_up(account), account.deviation.values, rtol=0, atol=1e-12)
    np.testing.assert_allclose(account.causes[0].values, 5 * SHAPE, atol=1e-5)
    assert list(np.flatnonzero(account.excluded)) == [17]
    assert account.remainder.values[17] == pytest.approx(400, abs=1e-4)
    assert abs(account.remainder.largest) < 1e-4
    np.testing.assert_array_equal(account.sd, 2.0)
    assert account.causes[0].largest_sigma == pytest.approx(2.5 * np.abs(SHAPE).max(), abs=1e-4)


@pytest.fixture(scope="module")
def drifting(tmp_path_factory: pytest.TempPathFactory) -> tuple[Diagnosis, Array]:
    """Return the diagnosis of a resonance that drifts, and by how much at each point [Hz]."""
    time = np.linspace(50, 4000, 40)
    change = 1.2e6 * 2e-8 * (time - time[0])
    frequency = 1.2e6 + change + 0.1 * np.random.default_rng(3).standard_normal(40)
    data = measurement.series({"time": time}, frequency, np.full(40, 0.1))
    path = tmp_path_factory.mktemp("drift") / "drift.nc"
    measurement.write(measurement.bundle({"series": data}, geometry="square-270um"), path)
    return diagnose(path), change


def test_a_drift_changes_each_frequency_by_rate_and_time(
    drifting: tuple[Diagnosis, Array],
) -> None:
    diagnosis, change = drifting
    assert diagnosis.causes == ("frequency_drift",)
    assert diagnosis.contributions is not None
    (account,) = diagnosis.contributions.accounts
    (cause,) = account.causes
    # The slope is known to 0.1 Hz √(12/40) over the whole time
    np.testing.assert_allclose(cause.values, change, atol=5 * 0.1 * np.sqrt(12 / 40))
    assert (account.quantity, account.unit) == ("frequency", "Hz")
    assert cause.where == "frequency at time = 4000 s"
    assert cause.largest_sigma == pytest.approx(change[-1] / 0.1, rel=0.01)


def test_the_record_and_the_table_hold_what_was_found(
    drifting: tuple[Diagnosis, Array], tmp_path: Path
) -> None:
    diagnosis, _ = drifting
    write(diagnosis, tmp_path)
    kept = json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))
    assert kept == json.loads(json.dumps(record(diagnosis)))
    assert diagnosis.contributions is not None
    (account,) = diagnosis.contributions.accounts
    (told,) = kept["contributions"]["data"]
    assert told["count"] == 40
    assert told["causes"]["frequency_drift"] == {
        "rms": account.causes[0].rms,
        "largest": account.causes[0].largest,
        "largest_sigma": account.causes[0].largest_sigma,
        "where": account.causes[0].where,
    }
    assert told["interaction"]["part"] == 0
    table = pd.read_csv(tmp_path / "contributions.csv", keep_default_na=False)
    frame = diagnosis.contributions.to_dataframe()
    assert list(table) == list(frame)
    assert frame.attrs["units"] == {"time": "s"}
    np.testing.assert_allclose(table["frequency_drift"], account.causes[0].values, rtol=1e-11)
    total = table["frequency_drift"] + table["interaction"] + table["remainder"]
    np.testing.assert_allclose(total, table["deviation"], rtol=0, atol=1e-9)
    page = write_diagnosis(diagnosis, tmp_path).read_text(encoding="utf-8")
    assert "<h2>What each cause changes</h2>" in page
    assert page.count("data:image/webp;base64,") == 3


def test_a_diagnosis_without_causes_leaves_no_table_of_an_earlier_one(
    drifting: tuple[Diagnosis, Array], tmp_path: Path
) -> None:
    diagnosis, _ = drifting
    write(diagnosis, tmp_path)
    write(replace(diagnosis, contributions=None), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["diagnosis.json"]
    kept = json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))
    assert kept["contributions"] is None


def test_of_several_measurements_each_has_its_own_sum(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    pressure = np.linspace(0.1, 100, 24)
    groups = {}
    for name, own in (("first", 2e5), ("second", 4e5)):
        quality = 1 / (1 / own + 1e-6 * pressure)
        sd = 0.002 * quality
        groups[name] = measurement.series(
            {"pressure": pressure},
            quality_factor=quality + sd * rng.standard_normal(24),
            quality_factor_sd=sd,
        )
    path = tmp_path / "two.nc"
    measurement.write(measurement.bundle(groups, geometry="square-270um"), path)
    diagnosis = diagnose(path)
    assert diagnosis.contributions is not None
    assert diagnosis.causes == ("gas_damping",)
    frame = diagnosis.contributions.to_dataframe()
    assert set(frame["measurement"]) == {"first", "second"}
    for name, own in (("first", 2e5), ("second", 4e5)):
        rows = frame[frame["measurement"] == name]
        change = 1 / (1 / own + 1e-6 * pressure) - own
        np.testing.assert_allclose(rows["gas_damping"], change, atol=0.01 * own)


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param("spectrum", marks=pytest.mark.slow),
        *("response", "map", "series", "trace", "record"),
    ],
)
def test_every_datum_has_its_unit_and_its_place(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "file.nc"
    make(Case(kind, (), 2), path)
    tree = measurement.read(path)
    (name,) = tree.children
    model = pose(name, tree[name].to_dataset(), measured_device(tree.attrs, path))
    residuals = model.residuals((), dict(zip(_names(model), model.start, strict=True)), ())
    taken = np.concatenate([quantity.at for quantity in model.quantities])
    assert len(set(taken)) == len(taken)
    sizes, unit = model.quantity
    known = np.flatnonzero(np.isfinite(sizes))
    assert set(known) <= set(taken)
    assert taken.max() < len(residuals)
    for quantity in model.quantities:
        places = pd.DataFrame({axis: v for axis, (v, _) in quantity.coordinates.items()})
        assert len(places) == len(quantity.at) == len(quantity.sd)
        assert not places.duplicated().any()
        if quantity.unit == unit:
            np.testing.assert_allclose(quantity.sd, sizes[quantity.at])
        for k in (1, len(places) // 3 + 2, len(places) - 1):
            told = model.locate(int(quantity.at[k]))
            for axis in LOCATED[kind] & set(places):
                assert _written(kind, axis, places[axis].iloc[k]) in told


LOCATED = {
    "spectrum": {"mode"},
    "response": {"sweep", "frequency"},
    "map": {"harmonic", "x", "y"},
    "series": {"pressure"},
    "trace": {"harmonic", "step"},
    "record": {"time"},
}


def _names(model: MeasurementModel) -> list[str]:
    return [spec.name for spec in model.base]


def _written(kind: str, axis: str, value: Any) -> str:
    if isinstance(value, str):
        return value
    number = float(value)
    texts = {
        ("response", "frequency"): f"{number:.9g} Hz",
        ("map", "x"): f"x = {number * 1e6:.4g} µm".replace("-", "−"),
        ("map", "y"): f"y = {number * 1e6:.4g} µm".replace("-", "−"),
        ("series", "pressure"): f"pressure = {number:.4g} Pa",
        ("record", "time"): f"{number:.6g} s",
    }
    return texts.get((kind, axis), f"{axis} {number:g}")


def test_an_interaction_is_drawn_where_it_exceeds_the_noise() -> None:
    _, found = interacting()
    assert _legend(found.comparisons[0]) == ["added", "scaled", "interaction", "deviation"]
    (curves,) = found.comparisons
    assert isinstance(curves, Curves)
    (curve,) = curves.curves
    loud = replace(curves, curves=(replace(curve, sd=np.full(N, 1e3)),))
    assert "interaction" not in _legend(loud)
    assert found.plot().axes[1].get_title() == "remainder (σ)"
    with pytest.raises(ParameterError, match="comparison = 1: there are 1"):
        found.plot(1)


def _legend(comparison: Comparison) -> list[str]:
    legend = contributions_figure(comparison).axes[0].get_legend()
    assert legend is not None
    return [text.get_text() for text in legend.get_texts()]


def test_maps_show_every_term_of_a_harmonic_in_the_same_colours() -> None:
    axis = np.linspace(-1e-4, 1e-4, 5)
    bowl = np.outer(np.cos(axis * 1e4), np.cos(axis * 1e4)) + 0j
    data = np.stack([bowl, 0.1j * bowl])
    # All causes 1, none 0.2, without the first 0.5, without the second 0.6
    predictions = np.stack([data, 0.2 * data, 0.5 * data, 0.6 * data])
    models = ("all causes", "no cause", "one", "other")
    images = Images("map", models, np.array([1, 2]), axis, axis, data, predictions, 1e-3)
    figure = contributions_figure(images)
    panels = [axes for axes in figure.axes if axes.get_aspect() == 1]
    titles = [axes.get_title() for axes in panels[:5]]
    assert titles == ["deviation", "one", "other", "interaction", "remainder (σ)"]
    values = [np.asarray(axes.collections[0].get_array()) for axes in panels[:4]]
    deviation, one, other, together = values
    np.testing.assert_allclose(one + other + together, deviation, atol=1e-15)
    np.testing.assert_allclose(np.abs(together), 0.1 * bowl.real, atol=1e-15)
    limits = {axes.collections[0].get_clim() for axes in panels[:4]}
    assert len(limits) == 1


def test_the_interaction_of_one_cause_is_exactly_zero() -> None:
    rng = np.random.default_rng(8)
    whole, idle = rng.normal(size=(2, 1000))
    causes, together = contributed(np.stack([whole, idle, idle]))
    np.testing.assert_array_equal(causes[0], whole - idle)
    assert not together.any()
