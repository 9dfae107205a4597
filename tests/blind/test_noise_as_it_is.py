"""Real noise: the whole way from file to verdict."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from femnl.diagnose import diagnose
from femnl.effects import library
from femnl.io import measurement
from tests.blind.lab import Case
from tests.blind.lab import make as make_exact
from tests.blind.realistic.files import Draw, make


def test_sweeps_with_glitches_alone_are_adequate_and_the_glitches_are_listed(
    tmp_path: Path,
) -> None:
    truth = make(Draw("response", (), "glitches", "square-270um", 11), tmp_path / "file.nc")
    found = diagnose(tmp_path / "file.nc", effects=[])
    assert found.verdict == "adequate", found.where
    strong = [size for size in truth["glitches"] if size > 10]
    assert len(strong) <= len(found.excluded) <= len(truth["glitches"]) + 1
    assert found.excluded[0].where.startswith("sweep ")


@pytest.mark.parametrize(
    "draw",
    [
        pytest.param(
            Draw("response", (), "glitches", "square-270um", 2448401542), marks=pytest.mark.slow
        ),
        Draw("record", (), "glitches", "square-270um", 1828458032),
        Draw("record", (), "correlated noise", "square-270um", 711921186),
        Draw("record", (), "wrong sd", "square-270um", 3496539343),
        Draw("series", (), "correlated noise", "square-270um", 60008),
        Draw("series", (), "correlated noise", "square-270um", 60202),
        Draw("trace", (), "glitches", "square-270um", 1446199729),
        Draw("trace", (), "correlated noise", "square-270um", 5009),
        Draw("trace", (), "glitches", "square-270um", 6009),
        pytest.param(
            Draw("response", (), "glitches", "square-270um", 6017), marks=pytest.mark.slow
        ),
        pytest.param(
            Draw("response", (), "glitches", "square-270um", 6030), marks=pytest.mark.slow
        ),
    ],
    ids=lambda draw: f"{draw.kind}-{draw.regime}-{draw.seed}",
)
def test_nothing_but_noise_that_once_was_unexplained_is_adequate(
    draw: Draw, tmp_path: Path
) -> None:
    make(draw, tmp_path / "file.nc")
    found = diagnose(tmp_path / "file.nc")
    assert found.verdict == "adequate", found.where


@pytest.mark.parametrize(
    ("cause", "seed"), [("electrostatic_softening", 60416), ("thermal_stress", 61006)]
)
def test_weak_causes_of_a_series_are_named_in_noise_that_is_alike_in_neighbours(
    cause: str, seed: int, tmp_path: Path
) -> None:
    make(Draw("series", (cause,), "correlated noise", "square-270um", seed), tmp_path / "file.nc")
    found = diagnose(tmp_path / "file.nc")
    assert found.causes == (cause,)
    assert found.noise[0].correlation_length > 1.5


@pytest.mark.parametrize(
    "order",
    [range(30), [*range(0, 30, 2), *range(29, 0, -2)]],
    ids=["ramp", "up and down"],
)
def test_what_a_series_in_order_lacks_is_not_taken_for_correlated_noise(
    order: list[int], tmp_path: Path
) -> None:
    values = np.array(order, float)
    rng = np.random.default_rng(4)
    bent = 1.5e6 + 1.5 * np.sin(2 * np.pi * values / np.ptp(values)) + 0.5 * rng.normal(size=30)
    data = measurement.series({"voltage": values}, bent, np.ones(30))
    measurement.write(
        measurement.bundle({"gate": data}, geometry="square-270um"), tmp_path / "gate.nc"
    )
    found = diagnose(tmp_path / "gate.nc", effects=[])
    assert found.noise[0].correlation_length == 1.0


def test_noise_that_wanders_beside_a_shuffled_control_is_noise_and_a_drift_is_a_drift(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(6)
    time = 300.0 * np.arange(40)
    power = rng.permutation(np.linspace(1e-6, 1e-4, 40))
    wander = lfilter([0.6], [1.0, -0.8], rng.normal(size=60))[20:]
    for drift, verdict, causes in (
        (0.0, "adequate", ()),
        (1e-9, "explained", ("frequency_drift",)),
    ):
        measured = 1.5e6 * (1 + drift * time) + wander
        controls = {"laser_power": power, "time": time}
        data = measurement.series(controls, measured, np.ones(40))
        file = measurement.bundle({"night": data}, geometry="square-270um")
        measurement.write(file, tmp_path / f"{verdict}.nc")
        found = diagnose(tmp_path / f"{verdict}.nc")
        assert (found.verdict, found.causes) == (verdict, causes)
        assert found.noise[0].correlation_length > 2


def test_an_optical_spring_is_among_the_equals_where_the_stated_sd_is_too_small(
    tmp_path: Path,
) -> None:
    draw = Draw("series", ("optical_spring",), "wrong sd", "square-270um", 2831310181)
    truth = make(draw, tmp_path / "file.nc")
    found = diagnose(tmp_path / "file.nc")
    assert found.verdict == "ambiguous"
    sets = {found.causes, *(other.causes for other in found.alternatives)}
    assert sets == {("optical_spring",), ("photothermal",)}
    (noise,) = found.noise
    assert noise.found / noise.stated == pytest.approx(1 / truth["options"]["stated"], rel=0.25)


@pytest.mark.parametrize("seed", [9100, 9117])
def test_decays_with_spikes_alone_are_adequate_and_the_spikes_are_listed(
    seed: int, tmp_path: Path
) -> None:
    make(Draw("decay", (), "glitches", "square-270um", seed), tmp_path / "file.nc")
    found = diagnose(tmp_path / "file.nc")
    assert found.verdict == "adequate"
    assert found.excluded


@pytest.mark.parametrize(
    ("regime", "seed"), [("beside unknown", 192734879), ("inexact", 2051864008)]
)
def test_a_cause_of_a_record_is_named_in_part_with_a_share_that_is_true(
    regime: str, seed: int, tmp_path: Path
) -> None:
    draw = Draw("record", ("quadratic_stiffness",), regime, "square-270um", seed)
    truth = make(draw, tmp_path / "file.nc")
    found = diagnose(tmp_path / "file.nc")
    assert (found.verdict, found.causes) == ("explained in part", ("quadratic_stiffness",))
    (share,) = found.shares
    true = truth["shares"]["quadratic_stiffness"]["share"]
    assert share.share == pytest.approx(true, abs=0.1)


@pytest.mark.slow
def test_a_drift_that_moves_jumps_is_named_in_correlated_noise(tmp_path: Path) -> None:
    draw = Draw("response", ("frequency_drift",), "correlated noise", "square-270um", 1369825877)
    make(draw, tmp_path / "file.nc")
    found = diagnose(tmp_path / "file.nc")
    assert (found.verdict, found.causes) == ("explained", ("frequency_drift",))


@pytest.mark.slow
def test_what_a_mode_that_does_not_settle_leaves_at_two_jumps_is_no_glitch(
    tmp_path: Path,
) -> None:
    draw = Draw("response", ("unsettled_mode",), "as fabricated", "square-270um", 4149882297)
    make(draw, tmp_path / "file.nc")
    found = diagnose(tmp_path / "file.nc", effects=[library()["unsettled_mode"]])
    assert (found.verdict, found.causes) == ("explained", ("unsettled_mode",))
    assert not found.excluded


@pytest.mark.slow
def test_large_glitches_side_by_side_near_a_resonance_are_found(tmp_path: Path) -> None:
    """Three of twelve lie at neighbouring frequencies of different sweeps, and move the fit."""
    draw = Draw("response", (), "glitches", "square-270um", 2850179101)
    truth = make(draw, tmp_path / "file.nc")
    found = diagnose(tmp_path / "file.nc", effects=[library()["fano_background"]])
    assert found.verdict == "adequate"
    clear = [size for size in truth["glitches"] if size > 10]
    assert len(clear) <= len(found.excluded) <= len(truth["glitches"]) + 2


def test_a_glitch_among_samples_that_scatter_much_by_chance_is_found(tmp_path: Path) -> None:
    draw = Draw("record", (), "glitches", "square-270um", 1395795356)
    truth = make(draw, tmp_path / "file.nc")
    found = diagnose(tmp_path / "file.nc", effects=[library()["nonlinear_damping"]])
    assert found.verdict == "adequate"
    assert len(found.excluded) == len(truth["glitches"])


def test_a_glitch_larger_than_every_signal_does_not_hide_a_detector_that_clips(
    tmp_path: Path,
) -> None:
    draw = Draw("response", ("one_sided_saturation",), "glitches", "square-270um", 1525881494)
    truth = make(draw, tmp_path / "file.nc")
    effects = [library()[f"{name}_saturation"] for name in ("one_sided", "detector")]
    found = diagnose(tmp_path / "file.nc", effects=effects)
    assert (found.verdict, found.causes) == ("explained", ("one_sided_saturation",))
    assert len(found.excluded) == len([size for size in truth["glitches"] if size > 10])


@pytest.mark.parametrize(
    "draw",
    [
        pytest.param(
            Draw("decay", ("frequency_drift",), "lacking", "square-270um", 2818080428),
            marks=pytest.mark.slow,
        ),
        pytest.param(
            Draw("trace", ("trigger_jitter",), "lacking", "square-270um", 3760091054),
            marks=pytest.mark.slow,
        ),
    ],
    ids=lambda draw: draw.kind,
)
def test_what_takes_up_most_of_another_cause_that_the_library_lacks_is_not_named(
    draw: Draw, tmp_path: Path
) -> None:
    make(draw, tmp_path / "file.nc")
    known = [effect for effect in library().values() if effect.name not in draw.causes]
    found = diagnose(tmp_path / "file.nc", effects=known)
    assert (found.verdict, found.causes) == ("unexplained", ())


@pytest.mark.parametrize(
    ("cause", "seed"),
    [
        pytest.param("fano_background", 3196120473, marks=pytest.mark.slow),
        pytest.param("quintic_stiffness", 1965972220, marks=pytest.mark.slow),
    ],
)
def test_what_takes_up_most_of_a_cause_of_sweeps_that_the_library_lacks_is_not_named(
    cause: str, seed: int, tmp_path: Path
) -> None:
    make_exact(Case("response", (cause,), seed), tmp_path / "file.nc")
    known = [effect for effect in library().values() if effect.name != cause]
    found = diagnose(tmp_path / "file.nc", effects=known)
    assert (found.verdict, found.causes) == ("unexplained", ())


@pytest.mark.slow
def test_one_of_two_sets_that_take_up_nearly_all_is_told_with_the_other(tmp_path: Path) -> None:
    draw = Draw("spectrum", ("aspect_ratio",), "inexact", "square-270um", 171351765)
    make(draw, tmp_path / "file.nc")
    found = diagnose(tmp_path / "file.nc")
    assert found.verdict == "ambiguous"
    sets = {found.causes, *(rival.causes for rival in found.rivals)}
    assert sets == {("aspect_ratio",), ("stress_anisotropy",)}


@pytest.mark.slow
def test_a_cause_does_not_stand_alone_where_a_likelier_one_predicts_a_block_badly(
    tmp_path: Path,
) -> None:
    """The readout bends by another law than the library's, and its fit is 170 times as likely."""
    draw = Draw("response", ("nonlinear_readout",), "inexact", "square-270um", 1722664631)
    make(draw, tmp_path / "file.nc")
    known = [library()[name] for name in ("internal_resonance", "nonlinear_readout")]
    found = diagnose(tmp_path / "file.nc", effects=known)
    assert found.verdict == "ambiguous"
    assert found.causes == ("nonlinear_readout",)
    assert {other.causes for other in found.alternatives} >= {("internal_resonance",)}


@pytest.mark.slow
def test_a_record_that_begins_with_a_fast_decay_is_compared_from_its_begin(tmp_path: Path) -> None:
    # 15 dB in 3 s before the slow decay: the first points after the bend count with the fast piece
    draw = Draw("decay", ("energy_exchange",), "beside unknown", "square-270um", 1463437962)
    make(draw, tmp_path / "file.nc")
    found = diagnose(tmp_path / "file.nc")
    assert ("energy_exchange",) in {one.causes for one in found.alternatives}, found.where


def test_a_cause_that_fits_and_is_hardly_likelier_than_noise_is_told_so(tmp_path: Path) -> None:
    draw = Draw("decay", ("feed_through",), "correlated noise", "square-270um", 14464262)
    make(draw, tmp_path / "file.nc")
    found = diagnose(tmp_path / "file.nc", effects=[library()["feed_through"]])
    assert found.verdict == "unexplained"
    (fitted,) = [trial for trial in found.trials if trial.causes]
    assert fitted.p_value > 0.05
    assert fitted.against == ("is hardly likelier than the base model",)
    assert found.nearest.endswith("against it: is hardly likelier than the base model")


@pytest.mark.slow
def test_a_strong_leak_at_two_places_does_not_turn_the_phase(tmp_path: Path) -> None:
    draw = Draw("response", ("crosstalk",), "exact", "square-270um", 13765536)
    make(draw, tmp_path / "file.nc")
    found = diagnose(tmp_path / "file.nc", effects=[library()["crosstalk"]])
    assert (found.verdict, found.causes) == ("explained", ("crosstalk",))


@pytest.mark.slow
def test_a_leak_that_cables_colour_is_no_sloping_background(tmp_path: Path) -> None:
    draw = Draw("response", ("crosstalk",), "inexact", "square-270um", 42903341)
    make(draw, tmp_path / "file.nc")
    found = diagnose(tmp_path / "file.nc")
    assert (found.verdict, found.causes) == ("explained in part", ("crosstalk",))
    assert found.shares[0].share > 0.95
