"""A geometry file that cannot be used is met with one line: file, key, value, remedy.

Nothing else ever comes out.
"""

import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from femnl.core.errors import GeometryError
from femnl.device.geometry import load, parse, shipped

VALID = """name = "test"
source = "none"
[outline]
kind = "square"
side = "270 um"
[holes]
lattice = "square"
pitch = "8.56 um"
count = [30, 30]
radius = "0.9 um"
[film]
thickness = "183.75 nm"
young = "250 GPa"
poisson = 0.23
density = "3100 kg/m^3"
stress = "1101.5 MPa"
[readout]
gap = "3226.25 nm"
[model]
bending = true
edge = "clamped"
"""
CASES = tomllib.loads(
    Path(__file__).with_name("geometry_refusals.toml").read_text(encoding="utf-8")
)["case"]
ROUNDS = settings(derandomize=True, database=None, deadline=None, max_examples=300)


def complaint(text: str) -> str:
    with pytest.raises(GeometryError) as caught:
        parse(text, "device.toml")
    return str(caught.value)


def test_the_file_that_the_cases_spoil_is_valid() -> None:
    assert parse(VALID).name == "test"
    assert len(CASES) > 100


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["says"][:60])
def test_a_spoilt_file_is_refused_with_the_line_that_helps(case: dict[str, str]) -> None:
    assert VALID.count(case["replace"]) >= 1
    assert (
        complaint(VALID.replace(case["replace"], case["by"], 1)) == f"device.toml: {case['says']}"
    )


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        (
            "0.23",
            "0x" + "f" * 3000,
            f"[film] poisson = 0x{'f' * 58}…: expected a valid number, write e.g. poisson = 0.23",
        ),
        (
            "0.23",
            "9" * 5000,
            "not TOML: Exceeds the limit (4300 digits) for integer string conversion",
        ),
        (
            "[30, 30]",
            f"[30, 0x{'f' * 3000}]",
            f"[holes] count 2 = 0x{'f' * 58}…: expected less than or equal to 100000",
        ),
        ('"270 um"', "[" * 20_000, "not TOML: brackets nested too deep"),
        ('"270 um"', f'"{"1" * 10_000} um"', f'[outline] side = "{"1" * 59}…: expected a length'),
        (
            '"270 um"',
            f'"270 {"u" * 10_000}"',
            f'[outline] side = "270 {"u" * 55}…: expected a length',
        ),
        ('"test"', f'"{"a" * 101}"', f'name = "{"a" * 59}…: expected at most 100 letters'),
    ],
)
def test_endless_values_are_refused_in_a_short_line(old: str, new: str, line: str) -> None:
    found = complaint(VALID.replace(old, new, 1))
    assert found.startswith(f"device.toml: {line}")
    assert len(found.splitlines()) == 1
    assert len(found) < 250


def test_an_unprintable_name_of_a_file_does_not_break_the_line(tmp_path: Path) -> None:
    with pytest.raises(
        GeometryError, match=r"two\\nlines: neither a shipped geometry nor a file"
    ) as caught:
        load("two\nlines")
    assert len(str(caught.value).splitlines()) == 1
    with pytest.raises(GeometryError, match=r"cannot be read"):
        load(tmp_path / ("a" * 5000 + ".toml"))
    with pytest.raises(GeometryError, match=r"neither a shipped geometry nor a file"):
        load("a\0b")


def outcome(text: str) -> str:
    """What the reader makes of a text: the name of the device or its complaint."""
    try:
        return parse(text, "device.toml").name
    except GeometryError as error:
        return str(error)


NUMBERS = ["0", "-1", "1e308", "nan", "inf", "0x" + "f" * 400, "true", "2020-01-01"]
LISTS = ["[]", "{}", "[[]]", '["1 um", "2 um"]', "[1, 1]", "[100000, 1]"]
TEXTS = [
    "",
    "1 um",
    "1e-9 um",
    "1 Pa",
    "1 kg/m^3",
    "um",
    "square",
    "etched",
    "list",
    "polygon",
    "1 m/m*m",
    "1 m^-1*m^2",
    "1 degC",
]
VALUES = st.sampled_from([*NUMBERS, *LISTS, *(f'"{text}"' for text in TEXTS)])


@given(
    st.sampled_from([name for name, _ in shipped() if "etched" not in name]),
    st.integers(0, 10**6),
    VALUES,
)
@ROUNDS
def test_any_value_put_anywhere_gives_a_device_or_one_line(
    name: str, where: int, value: str
) -> None:
    lines = load(name).text.splitlines()
    places = [i for i, line in enumerate(lines) if " = " in line and not line.startswith("#")]
    place = places[where % len(places)]
    lines[place] = f"{lines[place].split(' = ')[0]} = {value}"
    assert len(outcome("\n".join(lines)).splitlines()) == 1


@given(st.text(max_size=30), st.integers(0, len(VALID)), st.integers(0, 20))
@ROUNDS
def test_any_text_put_anywhere_gives_a_device_or_one_line(insert: str, at: int, cut: int) -> None:
    assert len(outcome(VALID[:at] + insert + VALID[at + cut :]).splitlines()) == 1


@given(st.text(alphabet="0123456789.eE+-*/^()um kgGPaN²³µ·_", max_size=20))
@ROUNDS
def test_any_quantity_gives_a_device_or_one_line(quantity: str) -> None:
    assert len(outcome(VALID.replace("250 GPa", quantity)).splitlines()) == 1
