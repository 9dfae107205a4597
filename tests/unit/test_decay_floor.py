"""What counts as the floor of a record: nothing that lies far above its end for long."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from femnl.core.errors import MeasurementError
from femnl.fits.decay.readout import beats
from femnl.fits.decay.window import window
from femnl.io import measurement
from femnl.observe.decay.phases import Line, floor_after
from femnl.observe.decay.pieces import Piece
from femnl.observe.decay.record import power_record
from tests.blind.realistic.files import Draw, make
from tests.unit.decay_records import RATE, fitted, record

DECAY = Line(middle=5.0, level=-25.0, slope=-5.0, slope_sd=0.01)
POINTS = 20
"""Points of a second."""


def pieces(*ends: tuple[float, float]) -> list[Piece]:
    """Return pieces that begin where the one before ends, of a decay from 0 dB at 0 s.

    Args: ends: times [s] and powers [dB] at which the pieces end.
    """
    begin, high = 0.0, 0.0
    made = []
    for end, low in ends:
        first, stop = int(POINTS * begin), int(POINTS * end)
        made.append(Piece(first, stop, begin, end, high, low, 0.3, stop - first))
        begin, high = end, low
    return made


def test_what_swells_far_above_the_end_of_a_record_is_no_floor() -> None:
    found = pieces((10, -50), (13, -52), (15, -50), (22, -78), (30, -80))
    assert floor_after(DECAY, (0,), found) == (4,)


def test_a_floor_that_drifts_by_less_than_a_step_is_whole() -> None:
    found = pieces((10, -50), (13, -52), (15, -50), (18, -58), (30, -60))
    assert floor_after(DECAY, (0,), found) == (1, 2, 3, 4)


@pytest.mark.parametrize(("lasts", "first"), [(3.0, 1), (5.0, 3)])
def test_a_fade_is_part_of_the_floor_that_it_ends(lasts: float, first: int) -> None:
    found = pieces((10, -50), (13, -51), (18, -74), (18 + lasts, -76))
    assert floor_after(DECAY, (0,), found) == tuple(range(first, 4))


def test_a_plateau_that_rises_is_no_floor() -> None:
    assert floor_after(DECAY, (0,), pieces((10, -50), (14, -49.2), (30, -49.2))) == (1, 2)
    assert floor_after(DECAY, (0,), pieces((10, -50), (14, -35), (30, -35))) == ()


@pytest.mark.parametrize("seed", range(3))
def test_a_drive_that_is_on_again_leaves_the_rate_of_the_decay(seed: int) -> None:
    since = np.linspace(0, 20, 500, endpoint=False)
    # 60 dB down and 40 dB up again, read to 0.01 dB
    readings = 1 + 1e-3 * np.random.default_rng([1, seed]).normal(size=500)
    envelope = readings * np.where(since < 6 * np.log(10), np.exp(-since / 2), 0.1)
    time, power, _ = record(seed, envelope.astype(complex), length=24.0, floor=1e-12)
    assert fitted(time, power).fit["decay_rate"] == pytest.approx(RATE, rel=0.01)


def test_a_decay_of_a_few_points_is_fitted_or_refused() -> None:
    for seed in range(6):
        time, power, _ = record(seed, length=80.0, floor=1e-4, points=80)
        with suppress(MeasurementError):
            assert fitted(time, power).fit["decay_rate"] == pytest.approx(RATE, rel=0.1)


@pytest.mark.parametrize(("most", "least", "fewest"), [(7, 0.5, 2.5), (12, 2.0, 4.0)])
def test_too_few_points_for_the_fewest_periods_are_no_beats(
    most: int, least: float, fewest: float
) -> None:
    values = 10 * np.random.default_rng(1).normal(size=most)
    for count in range(2, most + 1):
        assert not beats(np.arange(count) / 10, values[:count], least, fewest)


def test_a_slow_rest_far_above_the_floor_is_compared_as_signal(tmp_path: Path) -> None:
    # A second decay of 5 dB in 3 s swells by 10 dB and ends 20 dB below; the floor lies at −86 dB
    path = tmp_path / "file.nc"
    make(Draw("decay", ("energy_exchange",), "beside unknown", "square-270um", 394471454), path)
    (group,) = measurement.read(path).children.values()
    record = power_record(group.to_dataset())
    seen = window(record)
    slow = (record.time > 2) & (record.time < 11)
    assert np.mean(seen.decay[slow]) > 0.95
    assert np.median(record.power[seen.floor]) < -80
