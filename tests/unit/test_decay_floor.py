"""What counts as the floor of a record: nothing that lies far above its end for long."""

from pathlib import Path

import numpy as np
import pytest

from femnl.fits.decay.window import window
from femnl.io import measurement
from femnl.observe.decay.phases import Line, floor_after
from femnl.observe.decay.pieces import Piece
from femnl.observe.decay.record import power_record
from tests.blind.realistic.files import Draw, make

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
