"""Results show themselves: tables to print, HTML for notebooks, figures, datasets with units."""

import re
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure

from femnl.core.comparison import Curve, Curves
from femnl.core.device import Model
from femnl.core.diagnosis import Diagnosis, Quality, Trial
from femnl.core.errors import ParameterError
from femnl.core.fit import Fit, MapFit, MotionFit, Parameter
from femnl.core.modes import Modes
from femnl.core.nonlinearity import Nonlinearity
from femnl.core.readout import HarmonicMap, HarmonicSpectrum
from femnl.core.spectrum import Assignment, FilmFit, Labelling, Peaks
from femnl.core.tables import Tabulated
from femnl.fits.record.terms import TermsFit
from femnl.io import measurement
from femnl.pipeline import solve_modes, solve_nonlinearity

TABLE = ("table", "thead", "tbody", "tr", "th", "td")
HOSTILE = '<script>alert("1 & 2")</script>'
F = np.linspace(0.99e6, 1.01e6, 101)
AXIS = np.linspace(-50e-6, 50e-6, 11)
BOWL = np.outer(np.cos(np.pi * AXIS / 1e-4), np.cos(np.pi * AXIS / 1e-4))
FIT = Fit(
    {
        "frequency": Parameter("frequency", 1e6, 0.25, "Hz"),
        "scale": Parameter("scale", 1.25, 0.003, "1"),
        "delay": Parameter("delay", -2e-6, np.inf, "s"),
    },
    np.eye(3),
    1.05,
    40,
    3,
    (f"a note {HOSTILE}",),
)
MAPS = HarmonicMap(AXIS, AXIS, np.array([1, 2]), np.stack([BOWL, 0.01j * BOWL]), 633e-9, 1e-3)


@pytest.fixture(scope="module")
def modes(device: Callable[..., Model]) -> Modes:
    """Three modes of a square of 100 µm."""
    return solve_modes(device('kind = "square"\nside = "100 um"'), 3, cache=False)


@pytest.fixture(scope="module")
def nonlinearity(modes: Modes) -> Nonlinearity:
    """The cubic coefficients of these modes, and their couplings."""
    return solve_nonlinearity(modes, tensor=True, cache=False)


def diagnosis() -> Diagnosis:
    """A verdict that one cause explains."""
    data = np.sin(np.arange(101.0))
    curve = Curve("a", F, data, np.full(101, 0.1), np.stack([0 * data, data]))
    curves = Curves("t", "frequency", "Hz", "signal", "V", ("base model", "gas"), (curve,))
    base = Parameter("frequency", 1e6, 2.0, "Hz")
    return Diagnosis(
        file=f"{HOSTILE}.nc",
        sha256="0",
        verdict="explained",
        causes=("gas_loading",),
        probability=0.998,
        parameters={
            "base": {"frequency": base},
            "gas_loading": {"mass": Parameter("mass", 0.5, 0.01, "1")},
        },
        alternatives=(),
        p_value=0.0,
        where="at high pressure",
        before=Quality(9.0, 8.0),
        after=Quality(1.0, 1.25),
        measure_next="nothing",
        base_parameters={"frequency": base},
        trials=(
            Trial((), 900.0, 0.0, 0.0, ("leaves a misfit",)),
            Trial(("gas_loading",), 100.0, 380.5, 0.4, ()),
        ),
        comparisons=(curves,),
    )


def film() -> FilmFit:
    """Two lines beside their modes."""
    parameters = {
        "scale": Parameter("scale", 1.05, 1e-5, "1"),
        "scatter": Parameter("scatter", 2e-5, 1e-5, "1"),
    }
    frequency = np.array([1.05e6, 2.1e6])
    fit = replace(FIT, parameters=parameters)
    deviation = np.array([1e-5, -2e-5])
    labels = (HOSTILE, "(2,2)")
    return FilmFit(fit, labels, frequency, np.ones(2), frequency / 1.05, deviation, None)


def peaks() -> Peaks:
    """Two lines of a sweep; the points do not tell the width of the second."""
    return Peaks(
        np.array([0.995e6, 1.005e6]),
        np.array([0.5, 1.0]),
        np.array([100.0, 50.0]),
        np.array([2.0, np.inf]),
        np.array([1.0, 0.5j]),
        np.full(2, 1e-3),
        F,
        np.ones(101, np.complex128),
        (F[0], F[-1]),
        1.0,
        (HOSTILE,),
    )


def assignment() -> Assignment:
    """Two lines given to modes, one of them spurious."""
    best = Labelling((0, None), ("(1,1)", None), 0.9)
    other = Labelling((None, 0), (None, "(1,1)"), 0.1)
    deviation = np.array([1e-5, np.nan])
    missing = (HOSTILE,)
    return Assignment(best, other, 1.05, 1e-5, 2e-5, missing, (("a", "b"),), 0.9, deviation)


def motion() -> MotionFit:
    """The motion at three steps, and what it predicts of two harmonics."""
    size = np.array([1e-7, 2e-7, 1e-7])
    signal = np.ones((3, 3), np.complex128)
    phase = np.array([0.1, -1.5, -3.0])
    return MotionFit(FIT, size, 0.01 * size, phase, np.full(3, 0.01), signal, signal)


def every(modes: Modes, nonlinearity: Nonlinearity) -> list[Tabulated]:
    """One result of each kind."""
    prediction = {"": MAPS.values}
    terms = TermsFit(("offset",), FIT, np.ones(50), 1e-3, np.nan)
    maps = MapFit(FIT, prediction, {"": 0 * MAPS.values})
    found = [modes, nonlinearity, FIT, maps, motion(), film(), peaks(), assignment()]
    return [*found, MAPS, diagnosis(), terms]


class Balanced(HTMLParser):
    """Refuse tags that are closed in another order than opened, and collect the cells."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.cells: list[str] = []
        self.seen: set[str] = set()

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.open.append(tag)
        self.seen.add(tag)
        if tag in ("td", "th"):
            self.cells.append("")

    def handle_startendtag(self, tag: str, attrs: Any) -> None:
        self.seen.add(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in ("td", "th"):
            self.cells[-1] += data


def column(table: str, name: str) -> list[str]:
    """Return the texts of a column of a printed table, whose gaps are two spaces or more."""
    body = [line for line in table.splitlines()[1:] if not line.startswith("  ")]
    head, *rows = [re.split(r"\s{2,}", line.strip()) for line in body]
    return [cells[head.index(name)] for cells in rows]


def numbers(cell: str) -> tuple[float, float]:
    """Return value and error of a cell such as (1.50 ± 0.02)·10⁻³."""
    power = re.search("·10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", cell)
    digits = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
    factor = 10.0 ** int(power[1].translate(digits)) if power else 1.0
    plain = re.sub("·10.*|[()]", "", cell).replace("−", "-")
    value, _, error = plain.partition(" ± ")
    return float(value) * factor, float(error or 0) * factor


def test_the_numbers_of_modes_in_the_table_are_those_of_the_arrays(
    modes: Modes, nonlinearity: Nonlinearity
) -> None:
    found = {
        "f (MHz)": (modes, modes.frequency * 1e-6, modes.frequency_error * 1e-6),
        "f/f₁": (modes, modes.ratio, modes.ratio_error),
        "m_eff (ng)": (modes, modes.effective_mass * 1e12, modes.effective_mass_error * 1e12),
        "k₃ (N/m³)": (nonlinearity, nonlinearity.k3, nonlinearity.k3_error),
        "α (µm⁻²)": (nonlinearity, nonlinearity.alpha * 1e-12, nonlinearity.alpha_error * 1e-12),
    }
    for name, (result, values, errors) in found.items():
        cells = [numbers(cell) for cell in column(result.summary(), name)]
        assert len(cells) == 3
        for (value, error), expected, own in zip(cells, values, errors, strict=True):
            assert error == pytest.approx(own, rel=0.5)
            assert value == pytest.approx(expected, abs=max(error, 1e-6 * abs(expected)))
    assert column(str(modes), "label") == [label or "–" for label in modes.label]


def test_modes_without_counterparts_say_that_their_errors_are_not_known(modes: Modes) -> None:
    table = replace(modes, coarse=None).summary()
    assert "±" not in table
    assert "errors are not known" in table


def test_parameters_carry_their_errors_and_units() -> None:
    assert column(FIT.summary(), "value") == [
        "1000000.00 ± 0.25",
        "1.2500 ± 0.0030",
        "−2·10⁻⁶ ± unknown",
    ]
    assert str(FIT).splitlines()[0] == "Fit of 40 numbers by 3 free parameters, χ²/ν = 1.05"
    assert re.search(r"frequency .* Hz\n", str(FIT))
    assert HOSTILE in str(FIT)
    frame = FIT.to_dataframe()
    assert frame["value"].tolist() == [1e6, 1.25, -2e-6]
    assert frame["sd"].tolist() == [0.25, 0.003, np.inf]
    assert frame["unit"].tolist() == ["Hz", "1", "s"]


def test_print_gives_a_table_and_repr_one_line(modes: Modes, nonlinearity: Nonlinearity) -> None:
    for result in every(modes, nonlinearity):
        printed = str(result)
        assert printed == result.summary()
        assert len(printed.splitlines()) > 2
        assert "array(" not in printed
        assert "array(" not in repr(result)
        assert len(repr(result).splitlines()) == 1
        assert repr(result).startswith(f"<{type(result).__name__}")


def test_html_is_well_formed_escaped_and_holds_the_same_cells(
    modes: Modes, nonlinearity: Nonlinearity
) -> None:
    for result in every(modes, nonlinearity):
        text = result._repr_html_()
        ElementTree.fromstring(f"<body>{text}</body>")
        parser = Balanced()
        parser.feed(text)
        assert not parser.open
        assert parser.seen <= {"div", "style", "p", "strong", "br", *TABLE}, type(result)
        assert all(cell in result.summary() for cell in parser.cells)
        assert HOSTILE not in text


def test_datasets_and_dataframes_carry_si_units(modes: Modes, nonlinearity: Nonlinearity) -> None:
    for result in (modes, nonlinearity, motion(), film(), peaks()):
        found = result.to_dataset()
        assert found.data_vars
        for name, values in found.data_vars.items():
            assert values.attrs["units"], name
        frame = result.to_dataframe()
        units = frame.attrs["units"]
        assert set(units) == set(frame.columns)
        for name in frame.columns:
            assert units[name] == found[name].attrs.get("units", "")
            np.testing.assert_array_equal(frame[name], found[name])
    assert modes.to_dataset()["frequency"].attrs == {"units": "Hz"}
    np.testing.assert_array_equal(modes.to_dataset()["frequency"], modes.frequency)
    assert nonlinearity.to_dataset()["alpha"].attrs == {"units": "m⁻²"}
    assert nonlinearity.to_dataset()["tensor"].shape == (3, 3, 3, 3)


def test_shapes_of_a_dataset_are_one_at_their_largest_and_cover_the_film(modes: Modes) -> None:
    found = modes.to_dataset()
    np.testing.assert_allclose(np.abs(found["shape"].values).max(axis=1), 1, atol=0.01)
    for axis in ("x", "y"):
        assert found[axis].attrs == {"units": "m"}
        np.testing.assert_allclose([found[axis].min(), found[axis].max()], [-50e-6, 50e-6])


def test_a_harmonic_map_becomes_a_measurement_that_can_be_written() -> None:
    found = MAPS.to_dataset()
    assert {name: found[name].attrs.get("units") for name in ("x", "y", "real", "imag")} == {
        "x": "m",
        "y": "m",
        "real": "V",
        "imag": "V",
    }
    np.testing.assert_array_equal(found["real"] + 1j * found["imag"], MAPS.values)
    assert found.attrs["noise_sd"] == 1e-3
    assert measurement.bundle({"map": found}, geometry="square-270um")["map"].attrs["kind"] == "map"
    assert column(str(MAPS), "largest |V| (V)") == ["1.000 ± 0.001", "0.010 ± 0.001"]
    assert column(str(MAPS), "at x (µm)") == ["0", "0"]


def test_a_map_without_a_single_value_has_a_table() -> None:
    empty = replace(MAPS, values=np.full_like(MAPS.values, np.nan))
    assert column(str(empty), "points") == ["0", "0"]
    assert column(str(empty), "at x (µm)") == ["–", "–"]


def test_trials_come_best_first() -> None:
    found = diagnosis()
    frame = found.to_dataframe()
    assert frame["causes"].tolist() == ["gas_loading", "base model"]
    assert frame["log_evidence"].tolist() == [380.5, 0.0]
    assert frame["against"].tolist() == ["", "leaves a misfit"]
    table = str(found)
    assert table.startswith(f"{HOSTILE}.nc: explained: gas_loading (probability 0.998)")
    assert re.search(r"gas_loading +mass +0.500 ± 0.010", table)
    assert table.index("gas_loading  100 ") < table.index("base model   900 ")
    assert "What was tried" not in str(replace(found, trials=()))


def test_every_plot_is_a_figure_with_units_on_its_axes(modes: Modes) -> None:
    volts = np.ones((3, 3), np.complex128)
    spectrum = HarmonicSpectrum(F[:3], np.arange(3), volts, 0.01 * np.ones((3, 3)), np.ones(3))
    sweep = measurement.response(F, np.ones(101), noise_sd=0.01)
    time = np.arange(50) * 1e-3
    trace = measurement.trace(time, np.sin(time)[None])
    terms = TermsFit((), FIT, np.full(50, 1e-3), 1e-3, np.nan)
    labels = [
        (film().plot(), "frequency (MHz)", "off its mode (ppm)"),
        (peaks().plot(sweep), "drive frequency (MHz)", "magnitude |V| (V)"),
        (diagnosis().plot(), "frequency (MHz)", "signal (mV)"),
        (motion().plot(spectrum), "drive frequency − 990.2 kHz (Hz)", "amplitude U (nm)"),
        (terms.plot(trace), "time (ms)", "output (mV)"),
        (MAPS.plot(), "", "mV"),
        (modes.plot(), "", "shape ξ"),
    ]
    for figure, across, up in labels:
        assert isinstance(figure, Figure)
        assert across in [axes.get_xlabel() for axes in figure.axes]
        assert up in [axes.get_ylabel() for axes in figure.axes]


def test_a_fit_is_drawn_with_the_data_that_it_was_made_to() -> None:
    response = {
        "frequency": Parameter("frequency", 1e6, 1.0, "Hz"),
        "linewidth": Parameter("linewidth", 1e3, 1.0, "Hz"),
        "alpha_ratio": Parameter("alpha_ratio", 0.0, 1.0, ""),
        "y_max": Parameter("y_max", 1.0, 0.1, "V/V"),
        "drive": Parameter("drive", 1.0, 0.0, "V"),
    }
    line = 500j / (1e6 - F + 500j)
    sweep = measurement.response(F, line, drive=[1.0], noise_sd=0.01)
    figure = replace(FIT, parameters=response).plot(sweep)
    assert figure.axes[0].get_ylabel() == "magnitude |V| (V)"
    assert len(figure.axes[0].lines) == 2
    with pytest.raises(ParameterError, match="kind 'response'"):
        FIT.plot(sweep)


def test_a_map_fit_draws_the_maps_that_it_knows() -> None:
    found = MapFit(FIT, {"": MAPS.values}, {"": 0 * MAPS.values})
    figure = found.plot(MAPS.to_dataset())
    assert [axes.get_title() for axes in figure.axes[:2]] == ["measured", "fitted"]
    with pytest.raises(ParameterError, match="name = 'red': the fit has the maps ''"):
        found.plot(MAPS.to_dataset(), "red")


def test_a_comparison_that_is_not_there_is_refused() -> None:
    with pytest.raises(ParameterError, match="comparison = 1: this diagnosis holds 1, from 0"):
        diagnosis().plot(1)
