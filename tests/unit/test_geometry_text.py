"""Results carry the text of what was solved, and models change by their text."""

from dataclasses import replace
from pathlib import Path

import h5py
import pytest

import femnl
from femnl.core.errors import GeometryError
from femnl.device.geometry import parse, shipped
from femnl.io.results.netcdf import write_modes


@pytest.mark.parametrize("name", [name for name, _ in shipped()])
def test_every_shipped_device_is_described_by_its_text(name: str) -> None:
    model = femnl.load(name)
    assert model.described == model.text
    stressed = replace(model, film=replace(model.film, stress=0.9 * model.film.stress))
    told = parse(stressed.described)
    assert told.film == stressed.film
    assert told.outline == model.outline


def test_a_file_of_modes_holds_the_device_that_was_solved(tmp_path: Path) -> None:
    model = femnl.load("circle")
    changed = replace(model, film=replace(model.film, stress=5e8), bending=False)
    modes = femnl.solve_modes(changed, 1, resolution=0.5, cache=False)
    write_modes(tmp_path / "modes.nc", modes)
    with h5py.File(tmp_path / "modes.nc") as file:
        text = str(file.attrs["model"])
    again = femnl.solve_modes(parse(text), 1, resolution=0.5, cache=False)
    assert again.frequency == pytest.approx(modes.frequency, rel=1e-12)
    assert parse(text).film.stress == 5e8


def test_a_device_that_no_text_describes_has_none() -> None:
    model = femnl.load("square-270um")
    other = femnl.load("circle")
    assert replace(model, outline=other.outline).described == ""
    assert replace(model, text="").described == ""
    assert replace(model, text=other.text).described == ""


def test_with_makes_the_device_of_a_file_with_another_value() -> None:
    model = femnl.load("square-270um-perforated")
    assert model.with_("film.stress", "500 MPa").film.stress == 5e8
    assert model.with_("holes.radius", "2 um").holes.radius == pytest.approx(2e-6)
    assert not model.with_("model.bending", False).bending
    twice = model.with_("film.poisson", 0.3).with_("film.stress", "1 GPa")
    assert (twice.film.poisson, twice.film.stress) == (0.3, 1e9)
    assert twice.described == twice.text
    # A table that the file leaves out is begun
    assert "[clamp]" not in model.text
    assert not model.with_("clamp.deflection", "1 GPa").clamp.rigid


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("film.stres", "1 GPa", "unknown key, did you mean stress"),
        ("film.stress", "1 kg", "expected a pressure"),
        ("film.stress", object(), "cannot be written as TOML"),
        ("film.stress.more", "1", "has no value 'film.stress.more'"),
        ("", "1", "has no value ''"),
    ],
)
def test_with_refuses_what_a_file_cannot_have(key: str, value: object, message: str) -> None:
    with pytest.raises(GeometryError, match=message):
        femnl.load("square-270um").with_(key, value)


def test_contradictions_are_refused() -> None:
    model = femnl.load("square-270um")
    changed = replace(model, film=replace(model.film, stress=5e8))
    with pytest.raises(GeometryError, match="its text no longer describes it"):
        changed.with_("film.poisson", 0.3)
    with pytest.raises(GeometryError, match="a length of 100 µm, but its edge spans 270 µm"):
        femnl.solve_modes(replace(model, outline=replace(model.outline, length=1e-4)))
