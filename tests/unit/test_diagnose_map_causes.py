"""Causes that only maps show, made by the laboratory: each is told from its rivals."""

from pathlib import Path

import numpy as np
import pytest

from femnl.core.diagnosis import Diagnosis
from femnl.diagnose import diagnose
from femnl.diagnose.criticism import criticise
from femnl.diagnose.multistart import extended
from femnl.diagnose.part_of_data import best_in_all
from femnl.diagnose.posing import Posing
from femnl.diagnose.search import search
from femnl.diagnose.sent import sent
from femnl.effects import library
from femnl.fits.least_squares import fit
from femnl.io import measurement
from femnl.observe.extended import ExtendedModel
from tests.blind.lab.film import device
from tests.blind.lab.maps import WAVELENGTH, MapBench

GAP = 3226.25e-9
STILL = {f"{part}{k}": 0.0 for part in "eq" for k in range(1, 5)}
AMPLITUDE = 3e-7


BASE = {
    "amplitude": AMPLITUDE,
    "contrast": 0.02,
    "theta": 0.8,
    "phase": 0.3,
    "x": 1e-6,
    "y": -2e-6,
}


def written(
    folder: Path,
    hidden: dict[str, dict[str, float]],
    rng: np.random.Generator,
    base: dict[str, float],
    *,
    timed: bool = True,
) -> Path:
    """The file of a map of 25 × 25 points with known causes."""
    bench = MapBench("square-270um", tuple(hidden), rng, points=25)
    groups = bench.measured(base, hidden, rng)
    if not timed:
        groups = {name: group.drop_vars("time") for name, group in groups.items()}
    path = folder / "map.nc"
    text = device("square-270um").text
    measurement.write(measurement.bundle(groups, geometry="square-270um", model=text), path)
    return path


def told(folder: Path, hidden: dict[str, dict[str, float]], *, timed: bool = True) -> Diagnosis:
    """The diagnosis of such a map."""
    return diagnose(written(folder, hidden, np.random.default_rng(4), BASE, timed=timed))


def worse(found: Diagnosis, *causes: str) -> float:
    """By how many σ a set of causes fits worse than the named one."""
    chi2 = {trial.causes: trial.chi2 for trial in found.trials}
    return float(np.sqrt(max(chi2[causes] - chi2[found.causes], 0.0)))


def within(found: Diagnosis, cause: str, truth: dict[str, float]) -> bool:
    own = found.parameters[cause]
    return all(abs(own[name].value - value) < 4 * own[name].sd for name, value in truth.items())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("thickness", "scale", "waist"),
    [
        (186e-9, 1.0, np.inf),
        (183.75e-9, 1.0, 2.5e-6),
        (180e-9, 1.02, 4e-6),
    ],
    ids=["thicker", "focused", "both"],
)
def test_another_film_or_a_focus_is_the_stack_and_no_stage(
    thickness: float, scale: float, waist: float, tmp_path: Path
) -> None:
    truth = {
        "gap": GAP,
        "thickness": thickness,
        "index_scale": scale,
        "aperture_square": float((WAVELENGTH / (np.pi * waist)) ** 2),
    }
    found = told(tmp_path, {"multilayer_fringe": truth})
    assert (found.verdict, found.causes) == ("explained", ("multilayer_fringe",))
    assert within(found, "multilayer_fringe", truth)
    amplitude = found.parameters["base"]["amplitude"]
    assert abs(amplitude.value - AMPLITUDE) < 4 * amplitude.sd
    assert worse(found, "stage_scale") > 100
    assert worse(found, "static_bow") > 100
    # The focus turns the fringe as the gap does, and its error says so.
    assert 1e-9 < found.parameters["multilayer_fringe"]["gap"].sd < 5e-9


@pytest.mark.slow
def test_motion_in_quadrature_is_told_from_crosstalk_and_from_drift(tmp_path: Path) -> None:
    found = told(tmp_path, {"mode_admixture": STILL | {"q1": 0.01, "q3": 0.02}})
    assert (found.verdict, found.causes) == ("explained", ("mode_admixture",))
    own = found.parameters["mode_admixture"]
    # Modes of a pair have any order, and all have any sign.
    pair = max(abs(own[name].value) for name in ("q1", "q2"))
    assert [pair, abs(own["q3"].value)] == pytest.approx([0.01, 0.02], abs=4 * own["q1"].sd)
    assert worse(found, "resonance_drift") > 30


@pytest.mark.slow
def test_what_two_modes_of_a_pair_do_in_one_phase_is_one_partner(tmp_path: Path) -> None:
    found = told(tmp_path, {"mode_admixture": STILL | {"q1": 0.01, "q2": 0.02}})
    assert (found.verdict, found.causes) == ("explained", ("doublet",))
    own = found.parameters["doublet"]
    assert abs(own["quadrature"].value) == pytest.approx(np.hypot(0.01, 0.02), rel=0.05)
    turn = abs(np.tan(own["turn"].value))
    assert min(turn, 1 / turn) == pytest.approx(0.5, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.6, 0.02])
def test_a_partner_in_quadrature_is_told_from_a_drift_along_its_axis(
    share: float, tmp_path: Path
) -> None:
    # As q₁ alone, a small share of the mode that is odd along the slow axis looks like a drift.
    pair = {"partner": 1.0, "in_phase": 0.0, "quadrature": share}
    found = told(tmp_path, {"doublet": pair})
    assert (found.verdict, found.causes) == ("explained", ("doublet",))
    assert worse(found, "resonance_drift") > 4
    own = found.parameters["doublet"]
    assert abs(own["quadrature"].value) == pytest.approx(share, abs=4 * own["quadrature"].sd)


@pytest.mark.slow
def test_a_faint_partner_along_the_slow_axis_cannot_be_told_from_a_drift(tmp_path: Path) -> None:
    pair = {"partner": 1.0, "in_phase": 0.0, "quadrature": 0.004}
    found = told(tmp_path, {"doublet": pair})
    assert found.verdict == "ambiguous"
    others = [other.causes for other in found.alternatives]
    assert {("doublet",), ("resonance_drift",)} <= {*others, found.causes}
    assert "along its other axis" in found.measure_next


def test_crosstalk_in_quadrature_is_told_from_an_admixture(tmp_path: Path) -> None:
    found = told(tmp_path, {"crosstalk": {"real": 1e-4, "imag": 4e-4}})
    assert (found.verdict, found.causes) == ("explained", ("crosstalk",))
    assert worse(found, "mode_admixture") > 10


DRIFT = {"detuning": 0.3, "drift": 1.5}


@pytest.mark.slow
def test_stripes_of_a_drifting_resonance_are_told_from_other_modes(tmp_path: Path) -> None:
    found = told(tmp_path, {"resonance_drift": DRIFT | {"linewidth": 100.0}})
    assert (found.verdict, found.causes) == ("explained", ("resonance_drift",))
    assert within(found, "resonance_drift", DRIFT)
    assert worse(found, "mode_admixture") > 50


@pytest.mark.slow
def test_a_map_without_times_does_not_blame_a_drift(tmp_path: Path) -> None:
    found = told(tmp_path, {"resonance_drift": DRIFT | {"linewidth": 100.0}}, timed=False)
    assert found.verdict == "unexplained"
    assert ("resonance_drift",) not in [trial.causes for trial in found.trials]


@pytest.mark.slow
def test_a_strong_partner_is_found_from_other_amplitudes(tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    truth = {"partner": 3.0, "in_phase": -0.47, "quadrature": 0.17}
    path = written(tmp_path, {"doublet": truth}, rng, BASE | {"amplitude": 4.35e-7, "theta": 0.21})
    model, effects = Posing(path, None, sent([library()["doublet"]], 1))(None)
    base = fit(ExtendedModel(model), model.start)
    (pointer,) = criticise(base, effects).pointers or ()
    near = best_in_all(extended(base, pointer.effect, list(pointer.shapes)), base)
    assert near.chi2 > 10 * near.degrees
    found = {candidate.names: candidate.result for candidate in search(model, effects)}
    assert found["doublet",].chi2 < 1.2 * found["doublet",].degrees


def test_a_strong_partner_is_found_though_others_gain_sooner(tmp_path: Path) -> None:
    """It moves the lobes, so that the fit without it lies at an end of the stage."""
    truth = {"partner": 1.0, "in_phase": 0.494, "quadrature": -0.0775}
    base = {"amplitude": 4.114e-7, "theta": 1.2533, "phase": -1.4848, "x": -8.5e-8, "y": 6.6e-7}
    path = written(tmp_path, {"doublet": truth}, np.random.default_rng(1), BASE | base)
    found = diagnose(path, effects=[library()["doublet"]])
    assert (found.verdict, found.causes) == ("explained", ("doublet",))
    own = found.parameters["doublet"]
    assert abs(own["in_phase"].value) == pytest.approx(0.494, abs=4 * own["in_phase"].sd)
