"""Devices and requests that no model of femnl holds for are refused with the limit."""

import numpy as np
import pytest

from femnl.core.device import Model
from femnl.core.errors import GeometryError, ParameterError
from femnl.core.resources import shipped
from femnl.device.geometry import load, parse
from femnl.device.geometry.validity import THINNEST, narrowest
from femnl.device.mesh import mesh
from femnl.mechanics.static_deflection import solve_static_deflection
from femnl.mechanics.static_deflection.shallow import SHALLOW, foreseen_depth, refuse_deep
from femnl.pipeline import solve_modes
from femnl.sweep.axes import check_axis, read_axis

FILM = """name = "film"
source = "a test"
[outline]
{outline}
[film]
thickness = "{thickness}"
young = "250 GPa"
poisson = 0.23
density = "3000 kg/m^3"
stress = "1 GPa"
"""
SQUARE = 'kind = "square"\nside = "100 um"'
TURNED = (
    'kind = "polygon"\npoints = [["0 um", "0 um"], ["70 um", "70 um"], ["69 um", "71 um"], '
    '["-1 um", "1 um"]]'
)


def film(thickness: str, outline: str = SQUARE) -> Model:
    """Return a film of a thickness."""
    return parse(FILM.format(thickness=thickness, outline=outline))


@pytest.mark.parametrize("thickness", ["1 m", "100 um", "5.01 um"])
def test_a_film_too_thick_for_its_width_is_refused(thickness: str) -> None:
    with pytest.raises(GeometryError, match=r"wide, and thin films are at least 20 times as wide"):
        film(thickness)


def test_a_thin_film_is_taken_up_to_the_limit() -> None:
    assert film("4.99 um").film.thickness == 4.99e-6
    for name, _ in shipped():
        device = load(name)
        assert narrowest(device.outline) > 10 * THINNEST * device.film.thickness


HOLE = '[holes]\nlattice = "list"\ncentres = [["1 um", "2 um"]]\n{size}\n'
DETAILS = {
    "a hole of 9.98e-10 m": HOLE.format(size='radius = "0.499 nm"'),
    "a hole of 9.8e-10 m": HOLE.format(size='semi_axes = ["0.49 nm", "0.2 nm"]'),
    "a strip of 9.9e-10 m": '[overhang]\nwidth = "0.99 nm"\n',
}


@pytest.mark.parametrize("told", DETAILS)
def test_a_detail_that_no_mesh_follows_is_refused(told: str) -> None:
    text = FILM.format(thickness="10 nm", outline=SQUARE)
    with pytest.raises(GeometryError, match=f"{told} in a film of 0.0001 m is finer than 1e-05"):
        parse(text + DETAILS[told])


@pytest.mark.slow
def test_the_finest_detail_that_is_taken_is_meshed() -> None:
    device = parse(
        FILM.format(thickness="10 nm", outline=SQUARE) + HOLE.format(size='radius = "0.51 nm"')
    )
    assert mesh(device, resolution=0.3).mesh.nelements > 1000


def test_the_narrowest_width_is_that_across_a_film_that_lies_askew() -> None:
    # Edges of 99 and 1.4 µm at 45°
    assert narrowest(film("10 nm", TURNED).outline) == pytest.approx(np.sqrt(2) * 1e-6, rel=1e-6)
    with pytest.raises(GeometryError, match=r"1\.414e-06 m wide"):
        film("1 um", TURNED)


def test_the_shear_that_is_left_out_is_one_percent_at_the_limit() -> None:
    """Mindlin's thick plate, simply supported, against Kirchhoff's, to second order in h/L."""
    correction = np.pi**2 / 12
    ratio = 1 / THINNEST
    wave = 2 * np.pi**2 * ratio**2  # (k h)²
    # Both terms of Mindlin's equation that lower ω²: shear and rotary inertia
    lowered = wave / 12 * (2 / (correction * (1 - 0.23)) + 1)
    assert 0.5 * lowered == pytest.approx(0.01, rel=0.2)


@pytest.mark.parametrize("pressure", [-1e12, 1e9])
def test_a_pressure_that_bends_a_film_too_deep_is_refused(pressure: float) -> None:
    modes = solve_modes(load("circle"), 1, cache=False, resolution=0.3)
    with pytest.raises(ParameterError, match=r"^bow: .* Pa bends a film of 0.00027 m by about"):
        solve_static_deflection(modes, pressure=pressure)


@pytest.mark.parametrize("pressure", [1e3, 1e6])
def test_the_depth_of_a_disc_is_foreseen(pressure: float) -> None:
    """Within a factor, and never so that a shallow bow would be refused."""
    device = load("circle")
    modes = solve_modes(device, 1, cache=False, resolution=0.3)
    depth = abs(solve_static_deflection(modes, pressure=pressure).depth)
    assert 0.9 < foreseen_depth(device, pressure) / depth < 2


def test_a_depth_that_is_no_number_is_refused_too() -> None:
    refuse_deep(SHALLOW, 1.0, 1.0)
    for depth in (1.01 * SHALLOW, -1.01 * SHALLOW, float("nan")):
        with pytest.raises(ParameterError, match="slopes are no longer small"):
            refuse_deep(depth, 1.0, 1.0)


def test_an_axis_that_changes_a_kind_is_refused_and_one_of_tables_is_not() -> None:
    base = {
        "name": "b",
        "outline": {"kind": "square", "side": "1 mm"},
        "film": dict(
            zip(
                ("thickness", "young", "poisson", "density", "stress"),
                ("1 um", "250 GPa", 0.23, "3000 kg/m^3", "1 GPa"),
                strict=True,
            )
        ),
    }
    kinds = read_axis({"outline": {"kind": ["square", "circle"]}})
    with pytest.raises(ParameterError, match=r"^axis outline\.kind: each kind has keys of its own"):
        check_axis(kinds, base)
    tables = [{"kind": "circle", "diameter": "1 mm"}, {"kind": "square", "side": "1 mm"}]
    check_axis(read_axis({"outline": tables}), base)
