"""Backgrounds of the drive that are not flat: the flank of a far resonance, and a near one."""

from pathlib import Path

import numpy as np
import pytest

from femnl.core.diagnosis import Diagnosis
from tests.physics.driven_sweeps import F0, STRONGEST, Bench, Complex

BENCH = Bench(width=20.0)
SPAN = float(np.ptp(BENCH.frequency))


def beside(centre: float, width: float, strength: float) -> Complex:
    """Return sweeps beside a driven oscillator at F0 + centre [Hz], solved without a pole.

    ẍ + 2π w ẋ + (2πf_p)² x = F: of second order in f. strength: its largest signal within the
    sweeps, in parts of that of the mode.
    """
    f = BENCH.frequency
    answer = 1 / ((F0 + centre) ** 2 - f**2 + 1j * f * width)
    answer = answer * strength * STRONGEST / np.abs(answer).max() * np.exp(0.9j)
    drive = BENCH.drives / BENCH.drives.max()
    return np.asarray(BENCH.volts(BENCH.amplitude()) + drive[:, None] * answer)


def names(found: Diagnosis) -> list[tuple[str, ...]]:
    """Return the set that is named and all that may be as right."""
    return [found.causes, *(other.causes for other in found.alternatives)]


@pytest.mark.slow
def test_the_flank_of_a_far_resonance_is_a_sloping_background(tmp_path: Path) -> None:
    found = BENCH.diagnose(tmp_path / "a.nc", beside(15 * SPAN, 0.5 * SPAN, 0.05))
    assert (found.verdict, found.causes) == ("explained", ("sloping_background",)), names(found)


@pytest.mark.slow
def test_a_broad_resonance_within_the_sweeps_is_a_fano_background(tmp_path: Path) -> None:
    centre = 0.2 * SPAN
    found = BENCH.diagnose(tmp_path / "a.nc", beside(centre, 0.6 * SPAN, 0.05))
    assert (found.verdict, found.causes) == ("explained", ("fano_background",)), names(found)
    for name, truth in (("offset", centre), ("width", 0.6 * SPAN)):
        value = found.parameters["fano_background"][name]
        assert value.value == pytest.approx(truth, abs=4 * value.sd)


@pytest.mark.slow
def test_a_flank_that_bends_less_than_noise_may_be_either(tmp_path: Path) -> None:
    found = BENCH.diagnose(tmp_path / "a.nc", beside(1.5 * SPAN, 0.5 * SPAN, 0.003))
    assert found.verdict == "ambiguous"
    assert {("sloping_background",), ("fano_background",)} <= set(names(found))
    assert "off resonance" in found.measure_next
