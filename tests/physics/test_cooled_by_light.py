"""Light that damps a mode by far more than the mode does by itself, as in published cooling."""

from pathlib import Path

import numpy as np
import pytest

from femnl.diagnose import diagnose
from femnl.io import measurement


# −0.998 takes nearly all loss away: Q is 500 times that in the dark
@pytest.mark.parametrize("times", [30, 500, -0.998])
def test_light_may_add_many_times_the_loss_in_the_dark_or_take_nearly_all(
    times: float, tmp_path: Path
) -> None:
    rng = np.random.default_rng(int(abs(times)))
    power = np.linspace(0, 1e-4, 25)
    dark = 3e5
    # A force that lags by ωτ takes off 1/Q = ωτ times what it adds to the spring
    spring = 2.0 * abs(times) / dark / power.max()
    loss = times / power.max()
    frequency = 1.47e6 * np.sqrt(1 - spring * power)
    quality = dark / (1 + loss * power)
    data = measurement.series(
        {"laser_power": power},
        frequency=frequency + 2.0 * rng.standard_normal(25),
        frequency_sd=np.full(25, 2.0),
        quality_factor=quality * (1 + 0.01 * rng.standard_normal(25)),
        quality_factor_sd=0.01 * quality,
    )
    path = tmp_path / "light.nc"
    measurement.write(measurement.bundle({"series": data}, geometry="square-270um"), path)
    found = diagnose(path)
    assert found.verdict == "ambiguous"
    equals = {one.causes for one in found.alternatives}
    assert {("optical_spring",), ("photothermal",)} <= equals
