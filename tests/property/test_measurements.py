"""What holds for every measurement.

Written and read it is the same, and what was mended once needs no mending again.
"""

import tempfile
from pathlib import Path

import numpy as np
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from femnl.core.errors import MeasurementError
from femnl.io import measurement

MANY = settings(derandomize=True, database=None, deadline=None, max_examples=30)
VOLTS = st.floats(-1e3, 1e3) | st.just(np.nan)
SIZES = st.integers(1, 6)


def axis(start: float, steps: list[float]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Rising positions."""
    return start + np.cumsum(steps)


@st.composite
def datasets(draw: st.DrawFn) -> xr.Dataset:
    """A measurement of any kind with any numbers, gaps included."""
    kind = draw(st.sampled_from(["response", "harmonic_map", "trace", "series", "spectrum"]))
    n = draw(SIZES)
    m = draw(SIZES)
    steps = st.lists(st.floats(1e-3, 1), min_size=m, max_size=m)
    if kind == "spectrum":
        frequency = draw(arrays.arrays(float, m, elements=st.floats(1, 1e9)))
        return measurement.spectrum(
            frequency, draw(arrays.arrays(float, m, elements=st.floats(1e-6, 1e3)))
        )
    if kind == "series":
        quality = draw(arrays.arrays(float, m, elements=st.floats(1, 1e9)))
        return measurement.series(
            {"pressure": draw(arrays.arrays(float, m, elements=st.floats(0, 1e5)))},
            quality_factor=quality,
        )
    volts = draw(arrays.arrays(float, (n, m), elements=VOLTS))
    if kind == "trace":
        return measurement.trace(axis(0, draw(steps)), volts, drive_frequency=np.full(n, 1e6))
    if kind == "response":
        frequency = np.tile(axis(1e6, draw(steps)), (n, 1))
        return measurement.response(
            frequency,
            volts + 1j * draw(arrays.arrays(float, (n, m), elements=VOLTS)),
            drive=np.full(n, 0.1),
        )
    place = axis(-1e-4, draw(steps)) * 1e-4
    cube = np.broadcast_to(volts[:, None, :], (n, m, m))
    return measurement.harmonic_map(
        place, place, np.arange(1, n + 1), cube + 0.5j, wavelength=633e-9
    )


@given(datasets())
@MANY
def test_what_is_written_is_read_again(dataset: xr.Dataset) -> None:
    try:
        tree = measurement.bundle({"any": dataset}, geometry="circle")
    except MeasurementError:  # such as a measurement of gaps alone
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "any.nc"
        measurement.write(tree, path)
        again = measurement.read(path)
        xr.testing.assert_identical(again["any"].to_dataset(), tree["any"].to_dataset())
        measurement.write(again, path)
        third = measurement.read(path)
    xr.testing.assert_identical(third["any"].to_dataset(), again["any"].to_dataset())
