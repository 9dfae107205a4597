"""A drive that grows slower, or faster, than its voltage."""

from pathlib import Path

import numpy as np
import pytest

from tests.physics.driven_sweeps import Bench

V = np.repeat([0.05, 0.1, 0.2, 0.4], 2)


@pytest.mark.parametrize("third", [-0.15, pytest.param(0.15, marks=pytest.mark.slow)])
def test_a_force_of_third_order_is_a_drive_that_does_not_follow(
    third: float, tmp_path: Path
) -> None:
    # F = V + cV³: slower than V for c < 0, as of an amplifier, faster for c > 0, as of a piezo.
    bench = Bench()
    volts = bench.volts(bench.amplitude(force=V + third * V**3))
    found = bench.diagnose(tmp_path / "a.nc", volts)
    assert (found.verdict, found.causes) == ("explained", ("drive_compression",)), (
        found.alternatives
    )
    kappa = found.parameters["drive_compression"]["kappa"]
    # V/(1 + κV²) is the force to first order, κ = −c.
    assert kappa.value == pytest.approx(-third, rel=0.1)
