"""A delay of the signal, and how it is told from a leak of the drive."""

from pathlib import Path

import numpy as np
import pytest

from tests.physics.driven_sweeps import F0, PHASES, Bench, Complex, lock_in


def delayed(bench: Bench, tau: float) -> Complex:
    """Return the sweeps as a lock-in sees them whose signal comes late.

    The phase that the delay has at resonance belongs to the reference of the lock-in.
    """
    volts = bench.volts(bench.amplitude())
    turn = 2 * np.pi * (bench.frequency[:, None] - F0) * tau
    return volts * lock_in(np.cos(PHASES - turn))


def test_a_delayed_signal_is_a_group_delay_and_no_crosstalk(tmp_path: Path) -> None:
    bench = Bench(width=200.0)
    found = bench.diagnose(tmp_path / "a.nc", delayed(bench, 10e-6))
    assert (found.verdict, found.causes) == ("explained", ("group_delay",)), found.alternatives
    tau = found.parameters["group_delay"]["tau"]
    assert tau.value == pytest.approx(10e-6, abs=4 * tau.sd)


@pytest.mark.slow
def test_a_leak_of_the_drive_is_crosstalk_and_no_delay(tmp_path: Path) -> None:
    bench = Bench(width=200.0)
    volts = bench.volts(bench.amplitude())
    leak = 2e-4 * np.exp(1j) / bench.drives.max()
    found = bench.diagnose(tmp_path / "a.nc", volts + leak * bench.drives[:, None])
    assert (found.verdict, found.causes) == ("explained", ("crosstalk",)), found.alternatives
