"""What a diagnosis shows: data beside models, free forms where no cause is known, one page."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from femnl.core.comparison import Curve, Curves, Images
from femnl.core.diagnosis import Diagnosis
from femnl.core.stages import Fringe, Motion
from femnl.diagnose import diagnose
from femnl.effects import library
from femnl.fits.map.pose import _upright
from femnl.io import measurement
from femnl.optics.sampled import harmonics
from femnl.plot.comparison import comparison_figure
from femnl.report.diagnosis import write_diagnosis

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


def test_the_page_tells_everything_and_runs_nothing(unexplained: Diagnosis, tmp_path: Path) -> None:
    page = write_diagnosis(replace(unexplained, geometry="square-270um"), tmp_path).read_text(
        encoding="utf-8"
    )
    assert "<h1>Unexplained</h1>" in page
    assert "<script" not in page
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
    assert "--geometry square-270um" in page
    assert page.count("data:image/webp;base64,") == len(unexplained.comparisons) == 1


def test_residuals_of_all_models_share_one_scale() -> None:
    x = np.linspace(1e6, 1.0001e6, 50)
    data = np.sin(np.arange(50.0))
    curve = Curve("a", x, data, np.full(50, 0.1), np.stack([0 * data, data]))
    figure = comparison_figure(
        Curves("t", "frequency", "Hz", "signal", "V", ("base model", "more"), (curve,))
    )
    left, *right = figure.axes
    assert [axes.get_title() for axes in right] == ["left by base model (σ)", "left by more (σ)"]
    assert right[0].get_ylim() == right[1].get_ylim()
    assert left.get_xlabel() == "frequency − 1 000 050 Hz (Hz)"


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
