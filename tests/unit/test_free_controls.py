"""Control variables that a file names itself: read, written, drawn, fitted, diagnosed."""

import json
from collections.abc import Mapping
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

from femnl.cli._main import run
from femnl.core.errors import MeasurementError
from femnl.device.geometry import load
from femnl.diagnose import diagnose
from femnl.effects import from_folder
from femnl.fits.response.each import fit_each_sweep
from femnl.fits.series.law import fit_series
from femnl.fits.series.pose import pose
from femnl.io import measurement
from femnl.io.labfiles import import_file
from femnl.io.measurement import controls
from femnl.observe.film import SimulatedFilm
from femnl.plot.measurement import figure
from femnl.plot.series import series_fit_figure
from femnl.plot.style import prefixed

GATE = np.linspace(-40.0, 60.0, 21)
"""Gate voltage [mV]."""
SLOPE = 37.0
"""Change of the frequency [Hz/mV]."""


def gated(sd: float = 2.0) -> NDArray[np.float64]:
    """Frequencies [Hz] that follow the gate."""
    noise = np.random.default_rng(11).normal(size=GATE.size)
    return np.asarray(1e6 + SLOPE * GATE + sd * noise)


def write_by_hand(
    path: Path, datasets: Mapping[str, tuple[object, str | None]], version: str = "1.2"
) -> None:
    """A series as another program writes it, with h5py alone."""
    with h5py.File(path, "w") as file:
        file.attrs["femnl_measurement"] = version
        file.attrs["geometry"] = "square-270um"
        group = file.create_group("gate")
        group.attrs["kind"] = "series"
        for name, (values, unit) in datasets.items():
            group[name] = values
            if unit is not None:
                group[name].attrs["units"] = unit


def by_hand(version: str = "1.2") -> dict[str, tuple[object, str | None]]:
    """The datasets of a series against a gate voltage in mV."""
    sd = np.full(GATE.size, 2.0)
    return {
        "gate_voltage": (GATE, "mV"),
        "frequency": (gated(), "Hz"),
        "frequency_sd": (sd, "Hz"),
    }


def test_a_series_against_a_gate_is_read_in_si_and_survives_writing(tmp_path: Path) -> None:
    write_by_hand(tmp_path / "g.nc", by_hand())
    tree = measurement.read(tmp_path / "g.nc")
    (line,) = tree.attrs["repairs"]
    assert line.endswith("gate/gate_voltage: converted from mV to V")
    found = tree["gate"].to_dataset()
    assert controls(found) == {"gate_voltage": "V"}
    np.testing.assert_allclose(found["gate_voltage"].values, GATE * 1e-3, rtol=1e-15)
    measurement.write(tree, tmp_path / "h.nc")
    again = measurement.read(tmp_path / "h.nc")
    assert again.attrs["repairs"] == ()
    assert again["gate"].to_dataset().equals(found)


@pytest.mark.parametrize(
    ("unit", "stored", "factor"),
    [
        ("V", "V", 1.0),
        ("mV", "V", 1e-3),
        ("mT", "T", 1e-3),
        ("kV/m", "V/m", 1e3),
        ("nm", "m", 1e-9),
        ("1/V", "1/V", 1.0),
        ("mV^2", "V^2", 1e-6),
        ("psi", "Pa", 6894.757293168361),
        ("%", "", 0.01),
        ("1", "", 1.0),
    ],
)
def test_any_unit_comes_into_the_si(unit: str, stored: str, factor: float) -> None:
    built = measurement.series({"knob": GATE}, gated(), units={"knob": unit})
    found = measurement.bundle({"s": built})["s"].to_dataset()
    assert controls(found) == {"knob": stored}
    np.testing.assert_allclose(found["knob"].values, GATE * factor, rtol=1e-12)


def test_degrees_celsius_become_kelvin_and_a_known_name_takes_its_own_unit() -> None:
    built = measurement.series(
        {"stage": [20.0, 30.0], "pressure": [1.0, 2.0]},
        [1e6, 1e6],
        units={"stage": "degC", "pressure": "mbar"},
    )
    found = measurement.bundle({"s": built})["s"].to_dataset()
    assert controls(found) == {"pressure": "Pa", "stage": "K"}
    np.testing.assert_allclose(found["stage"].values, [293.15, 303.15])
    np.testing.assert_allclose(found["pressure"].values, [100.0, 200.0])


@pytest.mark.parametrize("version", ["1.0", "1.1"])
def test_older_files_go_on_as_they_were(version: str, tmp_path: Path) -> None:
    held = by_hand() | {"pressure": (np.linspace(1, 2, GATE.size), "Pa")}
    write_by_hand(tmp_path / "g.nc", held, version)
    tree = measurement.read(tmp_path / "g.nc")
    assert controls(tree["gate"].to_dataset()) == {"pressure": "Pa"}
    (line,) = tree.attrs["repairs"]
    assert "gate_voltage: not a dataset of kind series, left out; a file of version 1.2" in line


@pytest.mark.parametrize(
    ("extra", "expected"),
    [
        ({"gate voltage": (GATE, "mV")}, "'gate voltage' cannot name a control variable"),
        ({"[b]x": (GATE, "mV")}, "'[b]x' cannot name a control variable"),
        ({"point": (GATE, "mV")}, "'point' cannot name a control variable"),
        ({"gate_voltage": (GATE, "flurb")}, "unit 'flurb' is unknown; give a unit such as 'V'"),
        ({"gate_voltage": (GATE, "9**9**9")}, "unit '9**9**9' is unknown"),
        ({"gate_voltage": (GATE, "gauss")}, "unit 'gauss' is unknown"),
        ({"gate_voltage": (GATE[:-1], "mV")}, "gate_voltage: shape (20,) does not fit"),
        ({"gate_voltage": (GATE, None)}, "or in a file of version 1.2 another with its unit"),
    ],
)
def test_a_name_or_a_unit_that_is_none_is_one_line(
    extra: dict[str, tuple[object, str | None]], expected: str, tmp_path: Path
) -> None:
    held = {name: value for name, value in by_hand().items() if name != "gate_voltage"}
    write_by_hand(tmp_path / "g.nc", held | extra)
    with pytest.raises(MeasurementError) as caught:
        measurement.read(tmp_path / "g.nc")
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("control", "units", "expected"),
    [
        ({"gate": [1.0, 2.0]}, {}, "control variable 'gate' needs its unit"),
        ({"gate": [1.0, 2.0]}, {"gate": "V", "gat": "V"}, "units has 'gat'"),
        ({"frequency_sd": [1.0, 2.0]}, {"frequency_sd": "Hz"}, "is no control variable but a"),
        ({"gate_sd": [1.0, 2.0]}, {"gate_sd": "V"}, "'gate_sd' cannot name a control variable"),
        ({"pressure": [1.0, 2.0]}, {"pressure": "V"}, "'V' is not a unit of this quantity"),
    ],
)
def test_the_builder_refuses_in_one_line(
    control: dict[str, list[float]], units: dict[str, str], expected: str
) -> None:
    with pytest.raises(MeasurementError) as caught:
        measurement.series(control, [1e6, 1e6], units=units)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_its_law_has_the_slope_in_its_unit() -> None:
    built = measurement.series(
        {"gate_voltage": GATE}, gated(), np.full(GATE.size, 2.0), units={"gate_voltage": "mV"}
    )
    (found,) = fit_series(built)
    slope = found.fit.parameters["slope"]
    # sd of a slope by linear regression: σ/√Σ(x − x̄)²
    exact = 2.0 / np.sqrt(np.sum((GATE - GATE.mean()) ** 2)) * 1e3
    assert slope.unit == "Hz/V"
    assert slope.sd == pytest.approx(exact, rel=1e-6)
    assert abs(slope.value - SLOPE * 1e3) < 4 * slope.sd
    drawn = series_fit_figure(found)
    assert drawn.axes[1].get_xlabel() == "gate voltage (V)"


def test_its_power_law_has_the_exponent_and_its_slope_by_a_field_has_brackets() -> None:
    field = np.geomspace(1.0, 100.0, 15)
    noise = 1 + 1e-3 * np.random.default_rng(2).normal(size=15)
    built = measurement.series(
        {"field": field}, quality_factor=1e4 * field**-1.5 * noise, units={"field": "kV/m"}
    )
    (power,) = fit_series(built, "power")
    exponent = power.fit.parameters["exponent"]
    assert abs(exponent.value + 1.5) < 4 * exponent.sd < 0.01
    (line,) = fit_series(built)
    assert line.fit.parameters["slope"].unit == "1/(V/m)"


def test_it_is_drawn_with_its_unit_against_what_varies() -> None:
    built = measurement.series(
        {"temperature": np.full(GATE.size, 295.0), "gate_voltage": GATE},
        gated(),
        units={"gate_voltage": "mV"},
    )
    dataset = measurement.bundle({"s": built})["s"].to_dataset()
    assert list(controls(dataset)) == ["gate_voltage", "temperature"]
    assert figure(dataset).axes[0].get_xlabel() == "gate voltage (mV)"


@pytest.mark.parametrize(
    ("unit", "expected"),
    [("V", "mV"), ("V/m", "mV/m"), ("V^2", "V^2"), ("1/V", "1/V"), ("kg", "kg"), ("", "")],
)
def test_a_prefix_is_set_only_where_it_is_right(unit: str, expected: str) -> None:
    assert prefixed([0.02], unit)[1] == expected


def test_sweeps_at_several_gates_become_a_series_against_the_gate(tmp_path: Path) -> None:
    gates = np.array([0.0, 10.0, 20.0, 30.0])
    table = ["gate,f,x,y"]
    for gate in gates:
        f0 = 1e6 + SLOPE * gate
        f = np.linspace(f0 - 1e3, f0 + 1e3, 61)
        volts = f0 * 100 / ((f0 - f) * (f0 + f) + 1j * f * 100)
        table += [
            f"{gate},{a!r},{v.real:.12g},{v.imag:.12g}"
            for a, v in zip(f.tolist(), volts, strict=True)
        ]
    (tmp_path / "run.csv").write_text("\n".join(table), encoding="utf-8")
    (tmp_path / "run.toml").write_text(
        'kind = "response"\n[columns]\nfrequency = "f"\nreal = "x"\nimag = "y"\n'
        'gate_voltage = { column = "gate", unit = "mV" }\n',
        encoding="utf-8",
    )
    tree = import_file(tmp_path / "run.csv", tmp_path / "run.nc", tmp_path / "run.toml")
    dataset = tree["measurement"].to_dataset()
    np.testing.assert_allclose(dataset["gate_voltage"].values, gates * 1e-3)
    _, found = fit_each_sweep(dataset)
    assert controls(found) == {"gate_voltage": "V"}
    (line, _) = fit_series(found)
    assert line.fit.parameters["slope"].value == pytest.approx(SLOPE * 1e3, rel=1e-3)


def test_a_column_without_unit_says_how_to_give_one(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("g,f\n1,1e6\n2,1e6\n", encoding="utf-8")
    spec = 'kind = "series"\n[columns]\nfrequency = "f"\ngate = "g"\n'
    (tmp_path / "t.toml").write_text(spec, encoding="utf-8")
    with pytest.raises(MeasurementError, match=r"gate = \{ column = …, unit = \"V\" \}"):
        import_file(tmp_path / "t.csv", tmp_path / "t.nc", tmp_path / "t.toml")


def test_the_command_line_takes_the_control_of_a_law(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    held = by_hand() | {"time": (np.arange(float(GATE.size)), "s")}
    path = str(tmp_path / "g.nc")
    write_by_hand(Path(path), held)
    assert run(["fit", path, "--against", "gate_voltage", "--json"]) == 0
    fits = json.loads(capsys.readouterr().out)["fits"]
    slope = fits["gate, frequency"]["parameters"]["slope"]
    assert slope["unit"] == "Hz/V"
    assert abs(slope["value"] - SLOPE * 1e3) < 4 * slope["sd"]
    assert run(["fit", path]) == 2
    assert "time and gate_voltage vary" in capsys.readouterr().err
    assert run(["fit", path, "--law", "arrhenius"]) == 2
    assert "needs a temperature in K, and time and gate_voltage vary" in capsys.readouterr().err


def test_effects_never_take_it_for_what_they_need_by_name(tmp_path: Path) -> None:
    write_by_hand(tmp_path / "g.nc", by_hand())
    found = diagnose(tmp_path / "g.nc")
    # 2 kHz of shift at 2 Hz of noise; no shipped cause reads a gate
    assert found.verdict == "unexplained"
    assert "gate_voltage" in found.where
    for trial in found.alternatives:
        assert not {"electrostatic_softening", "thermal_stress"} & set(trial.causes)


def test_an_effect_of_ones_own_may_need_it(tmp_path: Path) -> None:
    (tmp_path / "gating.py").write_text(OWN, encoding="utf-8")
    write_by_hand(tmp_path / "g.nc", by_hand())
    found = diagnose(tmp_path / "g.nc", effects=from_folder(tmp_path).values())
    assert found.causes == ("gating",)
    value = found.parameters["gating"]["slope"]
    assert abs(value.value - SLOPE * 1e-3) < 4 * value.sd


@pytest.mark.parametrize("name", ["gap", "gas_loss", "per_pressure"])
def test_a_name_of_another_meaning_lends_no_effect_its_number(name: str, tmp_path: Path) -> None:
    built = measurement.series({name: GATE}, gated(), np.full(GATE.size, 2.0), units={name: "m"})
    path = tmp_path / "g.nc"
    measurement.write(measurement.bundle({"s": built}, geometry="square-270um"), path)
    found = pose(measurement.read(path)["s"].to_dataset(), SimulatedFilm(load("square-270um"), 12))
    assert found.varied == (name,)
    assert found.scales.get(name) != pytest.approx(float(np.ptp(GATE)))


OWN = """
from dataclasses import replace

from femnl.core.effect import Effect, ParameterSpec


def shift(points, values):
    gate = points.control["gate_voltage"]
    return replace(points, frequency=points.frequency * (1 + values["slope"] * gate))


EFFECT = Effect(
    name="gating",
    equation="f → f(1 + s V_g)",
    parameters=(ParameterSpec("slope", "1/V", -1.0, 1.0, scale="per_gate_voltage"),),
    changes={"points": shift},
    source="a test",
    limits="a test",
    sentence="the gate pulls the film",
    needs=("gate_voltage",),
)
"""
