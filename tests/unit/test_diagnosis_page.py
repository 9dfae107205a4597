"""What a diagnosis shows: data beside models, free forms where no cause is known, one page."""

import json
from dataclasses import replace
from hashlib import sha256
from html import unescape
from os import fsdecode
from pathlib import Path

import numpy as np
import pytest

import femnl
from femnl.core.comparison import Curve, Curves, Images
from femnl.core.diagnosis import Bound, Covariance, Diagnosis, Quality
from femnl.core.fit import Parameter
from femnl.core.numbers import engineering
from femnl.core.stages import Fringe, Motion
from femnl.device.geometry import load, parse
from femnl.diagnose import diagnose, record
from femnl.diagnose.files import write
from femnl.effects import library
from femnl.fits.map.pose import _upright
from femnl.io import measurement
from femnl.optics.sampled import harmonics
from femnl.plot.comparison import comparison_figure
from femnl.plot.quantiles import quantiles_figure
from femnl.plot.style import COLOURS
from femnl.report.diagnosis import write_diagnosis
from femnl.report.parameters import MOST, bound_rows, correlations, parameter_rows
from femnl.report.template import formula

SEED = 11


@pytest.fixture(scope="module")
def unexplained(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    """Return a resonance that follows the cube of the pressure, as no cause in the library does."""
    pressure = np.linspace(0, 100, 60)
    frequency = 1e6 + 40 * ((pressure - 50) / 50) ** 3 + np.random.default_rng(SEED).normal(size=60)
    dataset = measurement.series({"pressure": pressure}, frequency, np.full(60, 1.0))
    path = tmp_path_factory.mktemp("series") / "a <b> & c.nc"
    measurement.write(
        measurement.bundle(
            {"series": dataset}, geometry="square-270um", title="<script>alert(1)</script>"
        ),
        path,
    )
    return diagnose(path)


def test_what_no_cause_explains_is_described_by_a_free_form_that_predicts_unseen_data(
    unexplained: Diagnosis,
) -> None:
    assert (unexplained.verdict, unexplained.causes) == ("unexplained", ())
    best = unexplained.free_forms[0]
    assert best.sentence == "a cubic dependence on pressure"
    assert best.quality.chi2_reduced == pytest.approx(1, abs=0.5)
    assert unexplained.before.heldout_chi2_reduced > 50 * best.quality.heldout_chi2_reduced
    assert "a cubic dependence on pressure predicts unseen data best" in unexplained.where


def test_data_that_the_base_model_explains_get_no_free_form(tmp_path: Path) -> None:
    frequency = 1e6 + np.random.default_rng(SEED).normal(size=40)
    dataset = measurement.series({"pressure": np.linspace(0, 100, 40)}, frequency, np.full(40, 1.0))
    measurement.write(
        measurement.bundle({"series": dataset}, geometry="square-270um"), tmp_path / "file.nc"
    )
    found = diagnose(tmp_path / "file.nc")
    assert (found.verdict, found.free_forms) == ("adequate", ())


def test_free_forms_are_no_causes_of_the_library() -> None:
    assert "free_form" not in library()


def test_the_name_of_a_file_may_hold_bytes_of_no_encoding(
    unexplained: Diagnosis, tmp_path: Path
) -> None:
    found = replace(unexplained, file=fsdecode(b"\x80.nc"))
    write(found, tmp_path)
    known = json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))
    assert known["file"] == found.file
    assert r"\udc80.nc" in write_diagnosis(found, tmp_path).read_text(encoding="utf-8")


def test_the_page_tells_everything_and_runs_nothing(unexplained: Diagnosis, tmp_path: Path) -> None:
    page = write_diagnosis(replace(unexplained, geometry="square-270um"), tmp_path).read_text(
        encoding="utf-8"
    )
    assert "<h1>Unexplained</h1>" in page
    assert "<script" not in page
    # Nothing that reads as if something had been explained
    assert ">gain<" not in page
    assert "probability of the verdict" not in page
    assert "a &lt;b&gt; &amp; c.nc" in page
    for heading in (
        "Data, prediction, and what is left",
        "Parameters",
        "What was tried",
        "Described, not explained",
        "To reproduce",
    ):
        assert f"<h2>{heading}</h2>" in page
    assert unexplained.sha256 in page
    assert unexplained.nearest in page
    assert "--geometry square-270um" in page
    assert page.count("data:image/webp;base64,") == 1 + len(unexplained.comparisons) == 2


def test_where_nothing_explains_the_data_the_best_trial_is_drawn(unexplained: Diagnosis) -> None:
    trials = [trial for trial in unexplained.trials if trial.causes]
    best = max(trials, key=lambda trial: trial.log_evidence)
    assert unexplained.best_trial == best.causes
    (shown,) = unexplained.comparisons
    assert isinstance(shown, Curves)
    assert shown.models == ("base model", f"best trial: {' + '.join(best.causes)}")
    (curve,) = shown.curves
    left = ((curve.data - curve.predictions) / curve.sd) ** 2
    assert left.sum(axis=1) == pytest.approx([unexplained.trials[0].chi2, best.chi2], rel=1e-6)


def test_nearest_comes_no_saturated_set_and_all_that_was_tried_has_something_against_it(
    tmp_path: Path,
) -> None:
    orders = np.array([(1, 1), (1, 2), (2, 1), (2, 2)])
    away = 1e3 * np.array([1, -1, 2, -2])
    data = measurement.spectrum(
        1.11e6 / np.sqrt(2) * np.linalg.norm(orders, axis=1) + away,
        np.full(4, 5.0),
        label=["1,1", "1,2", "2,1", "2,2"],
    )
    path = tmp_path / "few.nc"
    measurement.write(measurement.bundle({"s": data}, geometry="square-270um"), path)
    causes = [library()[name] for name in ("added_mass", "shear_stress", "tension_gradient")]
    found = diagnose(path, effects=causes)
    assert found.verdict == "unexplained"
    # The film has two parameters, a mass four more and a gradient three; ℓ is known as well
    full = {t.causes for t in found.trials if "parameters for 4 data" in " ".join(t.against)}
    assert full == {("added_mass",), ("tension_gradient",)}
    assert all(trial.against for trial in found.trials)
    assert all(len(trial.causes) < 2 for trial in found.trials)
    assert found.nearest.startswith("nearest comes shear_stress, with χ² = ")
    assert found.nearest.endswith("; against it: leaves a misfit (chi-square)")


@pytest.fixture(scope="module")
def explained(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    """Return losses that grow with the pressure of a gas."""
    pressure = np.linspace(0, 300, 12)
    noise = 1 + 0.01 * np.random.default_rng(SEED).normal(size=12)
    quality = noise / (1 / 2e5 + 3e-8 * pressure)
    data = measurement.series(
        {"pressure": pressure}, quality_factor=quality, quality_factor_sd=0.01 * quality
    )
    path = tmp_path_factory.mktemp("series") / "gas.nc"
    measurement.write(measurement.bundle({"q": data}, geometry="square-270um"), path)
    return diagnose(path)


def test_a_cause_stands_on_the_page_with_its_equation_source_and_limits(
    explained: Diagnosis, tmp_path: Path
) -> None:
    page = unescape(write_diagnosis(explained, tmp_path).read_text(encoding="utf-8"))
    (name,) = explained.causes
    effect = library()[name]
    for text in (effect.equation, effect.source, effect.limits, f"femnl effects {name}"):
        assert text in page
    assert f'<a href="#cause-{name}">' in page
    assert f'id="cause-{name}"' in page
    assert f"/effects/{name}.html" in page
    # Definitions that pointer and keyboard reach
    for word in ("gain", "Share", "ln evidence"):
        assert f'<span class="term" tabindex="0">{word}<span role="tooltip">' in page


def test_the_file_holds_version_geometry_and_the_covariance_of_the_parameters(
    explained: Diagnosis,
) -> None:
    kept = record(explained)
    model = load("square-270um")
    assert kept["femnl_version"] == femnl.__version__
    assert kept["geometry"]["name"] == "square-270um"
    assert parse(kept["geometry"]["text"]).film == model.film
    assert kept["geometry"]["sha256"] == sha256(model.text.encode()).hexdigest()
    named = [(entry["of"], entry["name"]) for entry in kept["covariance"]["parameters"]]
    sd = [explained.parameters[owner][name].sd for owner, name in named]
    matrix = np.array(kept["covariance"]["matrix"])
    np.testing.assert_allclose(np.sqrt(np.diag(matrix)), sd, rtol=1e-9)
    assert len(named) == sum(map(len, explained.parameters.values()))


def test_an_ambiguous_page_names_all_sets_with_equation_and_probability(tmp_path: Path) -> None:
    """A film that warms as time goes by: temperature and time tell the same."""
    time = np.linspace(0, 7200, 25)
    rng = np.random.default_rng(1)
    temperature = 295 + time / 2400 + 0.002 * rng.normal(size=25)
    frequency = 1.5e6 * (1 - 3e-5 * (temperature - 296.5)) + rng.normal(size=25)
    data = measurement.series({"temperature": temperature, "time": time}, frequency, np.ones(25))
    measurement.write(
        measurement.bundle({"night": data}, geometry="square-270um"), tmp_path / "night.nc"
    )
    found = diagnose(tmp_path / "night.nc")
    assert found.verdict == "ambiguous"
    (rival,) = found.rivals
    assert {*found.causes, *rival.causes} == {"thermal_stress", "frequency_drift"}
    assert found.probability + rival.probability == pytest.approx(1, abs=0.01)
    page = write_diagnosis(found, tmp_path).read_text(encoding="utf-8")
    heading = page.split("<h1>")[1].split("</h1>")[0]
    assert "</a> or <a" in heading
    for cause in ("thermal_stress", "frequency_drift"):
        assert f'<h3 id="cause-{cause}">' in page
        assert f'href="#cause-{cause}"' in heading
    assert "α<sub>film</sub>" in page
    assert "−66" in page.split("What deviates")[1].split("</p>")[0]
    # One cause alone takes up its share whether or not it is alone
    assert "alone " not in page.split('class="shares"')[1].split("</table>")[0]


def test_a_page_that_is_sure_has_no_rivals(unexplained: Diagnosis) -> None:
    assert unexplained.rivals == ()


@pytest.mark.parametrize(
    ("equation", "shown"),
    [
        ("A e^{−γt/2}", "A e<sup>−γt/2</sup>"),
        ("Σ_n ξ_j (a_n + q)", "Σ<sub>n</sub> ξ<sub>j</sub> (a<sub>n</sub> + q)"),
        ("y_{j−1} < 2", "y<sub>j−1</sub> &lt; 2"),
        ("A_s²", "A<sub>s</sub>²"),
        ("gate_voltage <b>", "gate_voltage &lt;b&gt;"),
    ],
)
def test_formulas_are_set_and_nothing_else_is(equation: str, shown: str) -> None:
    assert str(formula(equation)) == shown


def test_parameters_count_in_units_that_their_errors_fit() -> None:
    """0.03 ± 0.13 nm, and not (0.3 ± 1.3)·10² pm; before and after share the unit."""
    known = {
        "small": Parameter("small", 30e-12, 130e-12, "m"),
        "large": Parameter("large", 399.8e-9, 0.12e-9, "m"),
        "begin": Parameter("begin", -790e-6, 340e-6, "V"),
    }
    before = {"begin": Parameter("begin", 3.16e-3, 0.34e-3, "V")}
    found = replace(
        Diagnosis(
            file="f",
            sha256="",
            verdict="explained",
            causes=("c",),
            probability=1.0,
            parameters={"base": known},
            alternatives=(),
            p_value=0.0,
            where="",
            before=Quality(1.0, 1.0),
            after=Quality(1.0, 1.0),
            measure_next="",
            base_parameters=before,
        )
    )
    rows = {name: rest for _, name, *rest in parameter_rows(found)}
    assert rows["small"] == ["–", "0.03 ± 0.13", "–", "nm"]
    assert rows["large"] == ["–", "399.80 ± 0.12", "–", "nm"]
    assert rows["begin"] == ["3.16 ± 0.34", "−0.79 ± 0.34", "–", "mV"]


def test_ranges_of_one_reason_share_a_row() -> None:
    bounds = [Bound("c", name, -1e-7, 1e-7, "m", "why") for name in ("cos2", "sin2")]
    rows = bound_rows((*bounds, Bound("c", "time", 0.0, 1.0, "s", "other")))
    assert rows == [
        ["c", "cos2, sin2", "−100", "100", "nm", "why"],
        ["c", "time", "0", "1", "s", "other"],
    ]


def test_a_correlation_that_rounds_to_zero_has_no_sign() -> None:
    matrix = np.array([[1.0, -1e-4], [-1e-4, 1.0]])
    found = correlations(Covariance(("base", "c"), ("a", "b"), matrix))
    assert found is not None
    assert found.rows[0][1][0] == "0.00"


def test_of_several_curves_each_line_has_the_colour_of_its_data() -> None:
    x = np.arange(5.0)
    curves = tuple(
        Curve(f"{k}f", x, x + k, np.full(5, 0.1), np.stack([x + k, x + k])) for k in range(3)
    )
    drawn = comparison_figure(
        Curves("trace", "step", "", "magnitude", "V", ("base model", "cause"), curves)
    )
    lines = [line for line in drawn.axes[0].lines if line.get_linestyle() in ("-", "--")]
    colours = [line.get_color() for line in lines if len(np.asarray(line.get_xdata())) == 5]
    assert colours == [colour for colour in COLOURS[:3] for _ in range(2)]


def test_correlations_of_two_slopes_are_those_of_least_squares() -> None:
    design = np.stack([np.ones(8), np.arange(8.0)], axis=1)
    matrix = np.linalg.inv(design.T @ design)
    found = correlations(Covariance(("base", "cause"), ("offset", "slope"), matrix))
    assert found is not None
    assert found.names == ["offset", "cause.slope"]
    # ρ = −Σx/√(n Σx²)
    rho = -28 / np.sqrt(8 * 140)
    text, size, sign = found.rows[0][1]
    assert (text, sign) == (f"−{-rho:.2f}", "negative")
    assert size == pytest.approx(-rho)
    assert found.rows[1][1][0] == "1.00"


def test_of_many_parameters_those_that_go_with_the_causes_are_shown() -> None:
    count = MOST + 3
    matrix = np.eye(count)
    matrix[-1, :-1] = matrix[:-1, -1] = np.linspace(0.01, 0.2, count - 1)
    owners = (*["base"] * (count - 1), "cause")
    found = correlations(Covariance(owners, tuple(f"p{k}" for k in range(count)), matrix))
    assert found is not None
    assert found.names == [*(f"p{k}" for k in range(3, count - 1)), f"cause.p{count - 1}"]
    assert found.left_out == 3


def test_normal_numbers_lie_in_the_band_of_the_quantile_plot_and_others_do_not() -> None:
    rng = np.random.default_rng(SEED)
    parts = []
    for draw in (rng.normal(size=5000), rng.standard_t(3, size=5000)):
        axes = quantiles_figure(draw).axes[0]
        band = np.asarray(axes.collections[0].get_paths()[0].vertices)
        (points,) = (line for line in axes.lines if line.get_label() == "residuals")
        x = np.asarray(points.get_xdata())
        y = np.asarray(points.get_ydata())
        assert len(x) <= 2000
        low, high = (
            np.array([pick(band[np.isclose(band[:, 0], at), 1]) for at in x])
            for pick in (np.min, np.max)
        )
        parts.append(float(np.mean((y >= low) & (y <= high))))
    assert parts[0] > 0.9
    assert parts[1] < 0.5


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (3.97e-7, "m", "397 nm"),
        (1.466e6, "Hz", "1.47 MHz"),
        (-8310.0, "Hz", "−8.31 kHz"),
        (9.9e-14, "kg", "99 pg"),
        (1.02, "kg/m³", "1.02 kg/m³"),
        (1e-18, "m^3", "1 µm³"),
        (6.9e9, "m^-2", "6.9·10⁹ m⁻²"),
        (2.5e-4, "1", "250 ppm"),
        (0.5, "1", "0.5"),
        (3e5, "s", "3·10⁵ s"),
        (2e-8, "m/V", "20 nm/V"),
        (0.0, "Hz", "0 Hz"),
        (float("inf"), "m", "inf m"),
    ],
)
def test_numbers_stand_in_units_that_people_use(value: float, unit: str, text: str) -> None:
    assert engineering(value, unit) == text


def test_residuals_of_all_models_share_one_scale() -> None:
    x = np.linspace(1e6, 1.0001e6, 50)
    data = np.sin(np.arange(50.0))
    curve = Curve("a", x, data, np.full(50, 0.1), np.stack([0 * data, data]))
    figure = comparison_figure(
        Curves("t", "frequency", "Hz", "signal", "V", ("base model", "more"), (curve,))
    )
    _, *below = figure.axes
    assert [axes.get_title() for axes in below] == ["left by base model (σ)", "left by more (σ)"]
    assert below[0].get_ylim() == below[1].get_ylim()
    assert below[1].get_xlabel() == "frequency − 1 000 050 Hz (Hz)"


def test_frequencies_of_modes_are_drawn_in_ppm() -> None:
    predicted = np.array([1e6, 2e6, 3e6])
    data = predicted * (1 + np.array([0.0, 5e-6, -7e-6]))
    curve = Curve("modes", np.arange(3.0), data, np.full(3, 1.0), predicted[None])
    found = Curves(
        "s", "mode", "", "frequency", "Hz", ("base model",), (curve,), ("a", "b", "c"), joined=False
    )
    top = comparison_figure(found).axes[0]
    assert top.get_ylabel() == "measured − predicted (ppm)"
    np.testing.assert_allclose(np.asarray(top.lines[0].get_ydata()), [0, 5, -7], atol=1e-6)


def test_maps_show_data_and_predictions_in_the_same_colours_and_residuals_too() -> None:
    axis = np.linspace(-1e-4, 1e-4, 9)
    bowl = np.outer(np.cos(axis * 1e4), np.cos(axis * 1e4)) + 0j
    data = np.stack([bowl, 0.1j * bowl])
    predictions = np.stack([0.9 * data, data])
    figure = comparison_figure(
        Images("map", ("base model", "more"), np.array([1, 2]), axis, axis, data, predictions, 1e-3)
    )
    limits = np.array(
        [axes.collections[0].get_clim() for axes in figure.axes if axes.get_aspect() == 1]
    )[:, 1].reshape(2, 5)
    np.testing.assert_array_equal(limits[:, [1, 3]], limits[:, [0, 0]])
    np.testing.assert_array_equal(limits[:, 2], limits[:, 4])
    assert [axes.get_title() for axes in figure.axes[:5]] == [
        "measured",
        "base model",
        "left (σ)",
        "more",
        "left (σ)",
    ]


@pytest.mark.parametrize("phase", [0.3, 2.0, 3.1, -2.9, 5.0])
def test_of_two_motions_that_read_the_same_the_one_near_the_drive_is_taken(phase: float) -> None:
    found = {"motion_phase": phase, "fringe_phase": 0.7, "amplitude": 2e-7}
    upright = _upright(found)
    assert abs(upright["motion_phase"]) <= np.pi / 2

    def read(of: dict[str, float]) -> np.ndarray[tuple[int, ...], np.dtype[np.complex128]]:
        swing = np.array([of["amplitude"] * np.exp(1j * of["motion_phase"])])
        one = np.ones((1, 1))
        place = np.zeros(1)
        motion = Motion(
            swing[None],
            np.array([of["fringe_phase"]]),
            place,
            place,
            one,
            np.ones(1),
            0,
            swing,
            6e-7,
        )
        return harmonics(motion, Fringe(np.array([0, 1], complex), 6e-7, None), np.arange(1, 7))

    np.testing.assert_allclose(read(upright), read(found), atol=1e-12)
