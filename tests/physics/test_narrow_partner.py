"""A second mode much narrower than the driven one, as that of the device of arXiv:2502.19191."""

from pathlib import Path

import numpy as np
import pytest

from tests.physics.driven_sweeps import F0, Bench, Complex

CROSSING = F0 + 9.0
COUPLING = 0.4
"""g [Hz] at the amplitude that stiffens the mode by one linewidth."""


def coupled(bench: Bench, width: float) -> Complex:
    """Return sweeps of a mode that drives another at twice its frequency by the square of a.

    (f_j/2 − f + iw_j/2) b = −k a², which leaves k a* b = −k²|a|²/(f_j/2 − f + iw_j/2) a.
    """
    # The strongest drive stiffens the mode by `stretch` linewidths.
    square = COUPLING**2 * bench.stretch
    pull = -square / (CROSSING - bench.frequency + 0.5j * width)
    return bench.amplitude(pull=np.asarray(pull, np.complex128))


@pytest.mark.slow
def test_a_partner_of_a_hundredth_of_the_linewidth_is_an_internal_resonance(
    tmp_path: Path,
) -> None:
    bench = Bench(stretch=6.0)
    width = 0.015 * bench.width
    volts = bench.volts(coupled(bench, width))
    found = bench.diagnose(tmp_path / "a.nc", volts)
    assert (found.verdict, found.causes) == ("explained", ("internal_resonance",)), (
        found.where,
        found.alternatives,
    )
    own = found.parameters["internal_resonance"]
    assert own["width"].value == pytest.approx(width, abs=4 * own["width"].sd)
    square = own["coupling_square"]
    assert square.value == pytest.approx(COUPLING**2, abs=4 * square.sd)


@pytest.mark.slow
def test_a_partner_above_the_drives_may_soften_a_mode_that_stiffens_by_itself(
    tmp_path: Path,
) -> None:
    bench = Bench(stretch=2.0)
    square = 60.0
    pull = -square * bench.stretch / (F0 + 12 - bench.frequency + 0.5j * bench.width)
    volts = bench.volts(bench.amplitude(pull=np.asarray(pull, np.complex128)))
    found = bench.diagnose(tmp_path / "a.nc", volts)
    assert any("the sweeps soften" in note for note in found.notes)
    assert (found.verdict, found.causes) == ("explained", ("internal_resonance",))
    own = found.parameters["internal_resonance"]
    assert own["width"].value == pytest.approx(bench.width, abs=4 * own["width"].sd)
    assert own["coupling_square"].value == pytest.approx(square, abs=4 * own["coupling_square"].sd)
