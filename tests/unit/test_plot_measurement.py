"""Figures of measurement files show what is in them."""

from io import BytesIO

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from femnl.io import measurement
from femnl.optics.harmonics import signal_phase
from femnl.plot.describe import describe
from femnl.plot.mapfit import map_fit_figure
from femnl.plot.maps import harmonic_map_figure
from femnl.plot.measurement import figure, figures
from femnl.plot.style import prefixed, scale_bar, style

RNG = np.random.default_rng(3)
LINE = 1e-3 / (1 + 1j * np.linspace(-8, 8, 201))
AXIS = np.linspace(-1e-4, 1e-4, 21)


def _dataset(kind: str) -> xr.Dataset:
    noise = 1e-6 * (RNG.normal(size=(3, 201)) + 1j * RNG.normal(size=(3, 201)))
    bowl = np.outer(np.cos(AXIS * 1e4), np.cos(AXIS * 1e4))
    time = np.arange(500) * 1e-8
    return {
        "spectrum": lambda: measurement.spectrum(
            [1e6, 1.0001e6, 2e6],
            [1.0] * 3,
            ["1,1", "1,2", "2,1"],
            quality_factor=[1e4, np.nan, 1e5],
        ),
        "response": lambda: measurement.response(
            1e6 + np.linspace(-80, 80, 201),
            np.array([[1], [2], [3]]) * LINE + noise,
            drive=[0.1, 0.2, 0.3],
            direction=[1, -1, 1],
        ),
        "map": lambda: measurement.harmonic_map(
            AXIS, AXIS, [1, 2, 3, 5], np.array([3e-3, -2e-4, 1j, 0])[:, None, None] * bowl
        ),
        "trace": lambda: measurement.trace(
            time, np.cos(6e6 * time)[None] * [[1], [2], [3]], drive_frequency=[1e6, 1.1e6, 1.2e6]
        ),
        "decay": lambda: measurement.decay(time, -1e6 * time, attributes={"frequency": 1e6}),
        "series": lambda: measurement.series(
            {"pressure": np.logspace(-3, 2, 9)},
            np.full(9, 1e6),
            np.full(9, 1.0),
            np.logspace(5, 3, 9),
        ),
    }[kind]()


@pytest.mark.parametrize("kind", sorted(measurement.KINDS))
def test_every_kind_is_drawn_and_described(kind: str) -> None:
    tree = measurement.bundle({"mine": _dataset(kind)}, title="a title")
    drawn = figures(tree)
    assert list(drawn) == ["mine"]
    buffer = BytesIO()
    drawn["mine"].savefig(buffer, format="png", dpi=40)
    assert buffer.getvalue().startswith(b"\x89PNG")
    assert all(
        axes.get_xlabel() or axes.get_ylabel() or axes.get_title() or not axes.axison
        for axes in drawn["mine"].axes
    )
    text = describe(tree)
    assert text.startswith("title: a title\nmine:\n")
    assert kind in text


def test_steps_of_which_one_has_no_frequency_are_counted() -> None:
    trace = _dataset("trace")
    trace = trace.assign_coords(drive_frequency=("step", [1e6, np.nan, 1.2e6]))
    (drawn,) = figures(measurement.bundle({"mine": trace})).values()
    assert "step" in [axes.get_ylabel() for axes in drawn.axes]


def test_a_map_has_a_panel_for_each_harmonic_with_colours_centred_on_zero() -> None:
    picture = harmonic_map_figure(
        _dataset("map"), outline=1e-4 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    )
    panels = [axes for axes in picture.axes if axes.get_title()]
    assert [axes.get_title().split()[0] for axes in panels] == ["1f", "2f", "3f", "5f"]
    for axes in panels:
        low, high = axes.collections[0].get_clim()
        assert low == -high
    outline = np.asarray(panels[0].lines[0].get_xydata())
    np.testing.assert_array_equal(outline[0], outline[-1])
    assert np.ptp(outline[:, 0]) == pytest.approx(2e-4)


def test_a_map_shows_the_quadrature_that_holds_the_signal_and_keeps_its_sign() -> None:
    shape = RNG.normal(size=50)
    for phase in (-1.2, 0.0, 0.4, 1.5):
        assert signal_phase(shape * np.exp(1j * phase)) == pytest.approx(phase, abs=1e-12)
    assert signal_phase((-shape).astype(complex)) == pytest.approx(0.0, abs=1e-12)


def test_sweeps_down_are_dashed_and_the_drives_are_named() -> None:
    magnitude = figure(_dataset("response")).axes[0]
    assert [line.get_linestyle() for line in magnitude.lines] == ["-", "--", "-"]
    legend = magnitude.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["100 mV", "200 mV", "300 mV"]
    peaks = [float(np.max(np.asarray(line.get_ydata(), dtype=float))) for line in magnitude.lines]
    np.testing.assert_allclose(peaks, [1, 2, 3], rtol=0.01)


@given(st.floats(1e-14, 1e14))
def test_a_prefix_brings_every_number_between_1_and_1000(value: float) -> None:
    divisor, unit = prefixed(value, "V")
    assert 1 <= value / divisor * (1 + 2e-9) < 1000 * (1 + 4e-9)
    assert unit.endswith("V")


@pytest.mark.parametrize(
    ("width", "text", "length"),
    [(270e-6, "50 µm", 50e-6), (0.81e-6, "200 nm", 200e-9), (4.0e-3, "1 mm", 1e-3)],
)
def test_the_scale_bar_is_as_long_as_it_says(width: float, text: str, length: float) -> None:
    with style():
        axes = harmonic_map_figure(_dataset("map")).axes[0]
    for artist in [*axes.texts, *axes.lines]:
        artist.remove()
    scale_bar(axes, width)
    assert axes.texts[0].get_text() == text
    assert np.ptp(np.asarray(axes.lines[0].get_xdata(), dtype=float)) == pytest.approx(length)


@pytest.mark.parametrize("axis", ["x", "y"])
def test_a_map_of_a_single_line_is_drawn_as_curves_and_so_is_its_fit(axis: str) -> None:
    volts = np.array([1e-3, 2e-4])[:, None] * np.cos(AXIS / 6e-5) * np.exp(0.3j)
    shaped = volts[:, None, :] if axis == "x" else volts[:, :, None]
    x, y = (AXIS, [1e-5]) if axis == "x" else ([1e-5], AXIS)
    found = measurement.harmonic_map(x, y, [1, 2], shaped, noise_sd=1e-5, wavelength=632.8e-9)
    for panel, expected in zip(
        harmonic_map_figure(found).axes, np.abs(volts) * np.sign(np.cos(AXIS / 6e-5)), strict=False
    ):
        (line,) = panel.lines
        assert np.allclose(line.get_xdata(), AXIS * 1e6)
        assert np.allclose(
            np.abs(line.get_ydata()),
            np.abs(expected) / np.abs(expected).max() * np.abs(line.get_ydata()).max(),
        )
    fitted = map_fit_figure(found, 0.9 * shaped, 0.1 * shaped / 1e-5)
    assert [axes.get_xlabel() for axes in fitted.axes] == ["", f"{axis} (µm)"]
    left = np.concatenate(
        [
            line.get_ydata()
            for line in fitted.axes[1].lines
            if np.size(line.get_xdata()) == len(AXIS)
        ]
    )
    assert np.allclose(np.abs(left), np.abs(0.1 * volts / 1e-5).ravel())
