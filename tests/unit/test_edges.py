"""Thickness of the film, springs at its edge and overhang, and what is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from femnl import pipeline as predict
from femnl.core.device import Clamp, Model
from femnl.core.errors import GeometryError, ParameterError
from femnl.device.geometry import curves, parse
from femnl.device.geometry.reader import describe
from femnl.device.mesh import mesh
from femnl.io.results.cache import key
from femnl.io.results.netcdf import read_modes, write_modes
from femnl.mechanics.lattice import solve_homogenised

DEVICE = """name = "test"
source = "none"
[outline]
kind = "square"
side = "100 um"
[film]
thickness = "100 nm"
young = "250 GPa"
poisson = 0.23
density = "3100 kg/m^3"
stress = "1 GPa"
"""
HOLES = '[holes]\nlattice = "square"\npitch = "20 um"\ncount = [4, 4]\nradius = "2 um"\n'


def device(more: str = "", outline: str | None = None) -> Model:
    return parse(
        DEVICE.replace(
            'kind = "square"\nside = "100 um"', outline or 'kind = "square"\nside = "100 um"'
        )
        + more,
        "device.toml",
    )


def test_springs_are_read_in_their_units_and_what_is_left_out_is_rigid() -> None:
    clamp = device('[clamp]\ndeflection = "20 GPa"\nrotation = "0.2 mN"\nshear = "0 Pa"\n').clamp
    assert clamp == Clamp(20e9, 0.2e-3, np.inf, 0.0)
    assert not clamp.rigid
    assert not clamp.rigid_in_plane
    assert device('[clamp]\nrotation = "0 N"\n').clamp.rigid_in_plane
    assert device().clamp.rigid
    assert device('[clamp]\nnormal = "1 GPa"\ndraw = "-5 nm"\n').clamp.draw == -5e-9


@pytest.mark.parametrize(
    ("outline", "box"),
    [
        ('kind = "square"\nside = "100 um"', (-60, -60, 60, 60)),
        ('kind = "rectangle"\nwidth = "100 um"\nheight = "60 um"', (-60, -40, 60, 40)),
        ('kind = "circle"\ndiameter = "100 um"', (-60, -60, 60, 60)),
        (
            'kind = "polygon"\npoints = [["0 um", "0 um"], ["100 um", "0 um"], ["100 um", "50 '
            'um"], ["0 um", "50 um"]]',
            (-10, -10, 110, 60),
        ),
        (
            'kind = "polygon"\npoints = [["0 um", "50 um"], ["100 um", "50 um"], ["100 um", "0 '
            'um"], ["0 um", "0 um"]]',
            (-10, -10, 110, 60),
        ),
    ],
)
def test_an_overhang_moves_every_side_outwards(outline: str, box: tuple[float, ...]) -> None:
    model = device('[overhang]\nwidth = "10 um"\n', outline)
    np.testing.assert_allclose(np.array(curves.box(model.edge_outline)) * 1e6, box, atol=1e-9)
    assert model.overhang
    assert model.overhang.film == model.film


def test_sides_of_a_hexagon_and_of_a_notched_polygon_move_by_the_width_of_the_overhang() -> None:
    notched = [
        ("0", "0"),
        ("100", "0"),
        ("100", "100"),
        ("60", "100"),
        ("60", "60"),
        ("40", "60"),
        ("40", "100"),
        ("0", "100"),
    ]
    points = ", ".join(f'["{x} um", "{y} um"]' for x, y in notched)
    for outline in (
        'kind = "regular-polygon"\nsides = 6\nlong_axis = "100 um"',
        f'kind = "polygon"\npoints = [{points}]',
    ):
        model = device('[overhang]\nwidth = "5 um"\n', outline)
        middles = np.array([np.add(s.start, s.end) / 2 for s in model.outline.segments])
        np.testing.assert_allclose(curves.distance(model.edge_outline, middles), 5e-6, rtol=1e-9)
        assert np.all(curves.contains(model.edge_outline, middles))


def test_an_overhang_around_an_etched_film_is_etched_further() -> None:
    model = device(
        HOLES + '[overhang]\nwidth = "2 um"\nthickness = "300 nm"\nstress = "500 MPa"\n',
        'kind = "etched"\netch_radius = "15 um"',
    )
    assert model.overhang
    assert (
        model.overhang.film.thickness,
        model.overhang.film.stress,
        model.overhang.film.young,
    ) == (300e-9, 500e6, 250e9)
    radii = {round(curves.radius(s) * 1e6, 9) for s in model.edge_outline.segments}
    assert radii == {17.0}
    assert all(
        np.all(curves.contains(model.edge_outline, curves.point_at(s, np.linspace(0, 1, 5))))
        for s in model.outline.segments
    )


def test_a_gradient_makes_the_film_thicker_along_it() -> None:
    model = device('gradient = ["1 nm/um", "0 nm/um"]\n')
    assert model.film.gradient == pytest.approx((1e-3, 0.0))


SPOILT = [
    (
        '[clamp]\nnormal = "0 Pa"',
        '[clamp] normal = "0 Pa": expected a force per length and displacement that is positive',
    ),
    (
        '[clamp]\ndeflection = "-1 GPa"',
        '[clamp] deflection = "-1 GPa": expected a force per length and displacement that is '
        "positive",
    ),
    (
        '[clamp]\ndeflection = "1 N/m"',
        '[clamp] deflection = "1 N/m": expected a force per length and displacement, write e.g. '
        '"20 GPa"',
    ),
    (
        '[clamp]\nrotation = "1 Pa"',
        '[clamp] rotation = "1 Pa": expected a moment per length and angle, write e.g. "0.2 mN"',
    ),
    (
        "[clamp]\nrotation = 1.0",
        "[clamp] rotation = 1.0: expected a moment per length and angle with its unit, in quotes",
    ),
    (
        '[clamp]\nshear = "-1 GPa"',
        '[clamp] shear = "-1 GPa": expected a force per length and displacement that is not '
        "negative",
    ),
    (
        '[clamp]\ndraw = "5 nm"',
        '[clamp] draw = "5 nm": it needs springs that draw, write e.g. normal = "20 GPa"',
    ),
    ('[clamp]\nnormals = "1 GPa"', '[clamp] normals = "1 GPa": unknown key, did you mean normal?'),
    ('clamp = "1 GPa"', '[film] clamp = "1 GPa": unknown key, expected one of'),
    (
        "[clamp]\nnormal = true",
        "[clamp] normal = true: expected a force per length and displacement with its unit",
    ),
    ("[overhang]", "[overhang] width is missing: write e.g. width ="),
    ('[overhang]\nwidth = "0 um"', '[overhang] width = "0 um": expected a length that is positive'),
    (
        '[overhang]\nwidth = "1 um"\ntaper = "1 nm"',
        '[overhang] taper = "1 nm": unknown key, expected one of width, thickness',
    ),
    (
        '[overhang]\nwidth = "1 um"\npoisson = 0.7',
        "[overhang] poisson = 0.7: expected less than 0.5",
    ),
    ("gradient = 1", "[film] gradient = 1: expected a valid list, write e.g. gradient ="),
    ('gradient = ["1 nm/um"]', "[film] gradient = ["),
    (
        'gradient = ["1 nm", "0 nm"]',
        '[film] gradient 1 = "1 nm": expected a change of thickness by length, write e.g. '
        '"0.1 nm/um"',
    ),
    ('gradient = ["1 m/m", "0 m/m"]', "from 1e-12 to 0.1 m/m, check the unit"),
    (
        'gradient = ["3 nm/um", "0 nm/um"]',
        "[film] gradient = [0.003, 0]: nothing is left of the film at a corner of its box",
    ),
    (
        '[clamp]\nnormal = "1 GPa"\n[model]\nedge = "sliding"',
        '[model] edge = "sliding": [clamp] says how the edge gives way in plane',
    ),
]


@pytest.mark.parametrize(("more", "line"), SPOILT, ids=[line[:50] for _, line in SPOILT])
def test_a_spoilt_edge_is_refused_in_one_line(more: str, line: str) -> None:
    with pytest.raises(GeometryError) as caught:
        device(more)
    assert line in str(caught.value)
    assert str(caught.value).startswith("device.toml: ")
    assert len(str(caught.value).splitlines()) == 1


def test_outlines_without_room_for_an_overhang_are_refused_in_one_line() -> None:
    corners = [(0, 0), (100, 0), (100, 100), (55, 100), (50, 60), (45, 100), (0, 100)]
    points = str([[f"{x} um", f"{y} um"] for x, y in corners]).replace("'", '"')
    with pytest.raises(
        GeometryError,
        match=r"\[overhang\] width = 50 um: an edge of the outline would vanish; lower width",
    ):
        device('[overhang]\nwidth = "50 um"\n', f'kind = "polygon"\npoints = {points}')
    with pytest.raises(
        GeometryError,
        match=r"\[overhang\] an outline with free edges has no strip of frame all around",
    ):
        device('[overhang]\nwidth = "5 um"\n', f'kind = "polygon"\nfree = [1]\npoints = {points}')


def test_every_way_to_hold_a_film_has_a_place_of_its_own_in_the_cache() -> None:
    devices = [
        "",
        '[clamp]\nnormal = "1 GPa"\n',
        '[clamp]\nshear = "1 GPa"\n',
        '[overhang]\nwidth = "5 um"\n',
        '[overhang]\nwidth = "5 um"\nstress = "1 MPa"\n',
        'gradient = ["0.1 nm/um", "0 nm/um"]\n',
    ]
    assert len({key(device(more), ()) for more in devices}) == len(devices)


def test_modes_with_an_overhang_survive_storage(tmp_path: Path) -> None:
    model = device(
        '[overhang]\nwidth = "5 um"\nthickness = "300 nm"\n[clamp]\nnormal = "1 GPa"\nshear = '
        '"1 GPa"\n'
    )
    modes = predict.solve_modes(model, 2, resolution=0.3, cache=False)
    write_modes(tmp_path / "modes.nc", modes)
    back = read_modes(tmp_path / "modes.nc", model)
    np.testing.assert_array_equal(
        (back.domain.mesh.subdomains or {})["overhang"],
        (modes.domain.mesh.subdomains or {})["overhang"],
    )
    alpha = [predict.solve_nonlinearity(m, cache=False).alpha for m in (modes, back)]
    np.testing.assert_array_equal(alpha[0], alpha[1])
    assert np.all(modes.frequency_error < 1e-3 * modes.frequency)


def test_a_listing_tells_of_clamp_and_overhang() -> None:
    assert describe(device('[overhang]\nwidth = "5 um"\n[clamp]\nnormal = "1 GPa"\n')).endswith(
        ", overhang 5 µm, elastic clamp"
    )


def test_the_homogenised_film_refuses_what_it_does_not_know() -> None:
    model = device(HOLES)
    for other in (
        replace(model, film=replace(model.film, gradient=(1e-4, 0.0))),
        device(HOLES + '[overhang]\nwidth = "5 um"\n'),
        replace(model, film=replace(model.film, taper=1e-8, taper_length=5e-6)),
    ):
        with pytest.raises(
            ParameterError,
            match="no gradient of the thickness and no taper; solve the full film",
        ):
            solve_homogenised(other, 1)


@pytest.mark.parametrize("symmetry", ["quarter", "eighth"])
def test_an_etched_film_with_an_overhang_is_meshed_in_every_wedge(symmetry: str) -> None:
    text = HOLES.replace("4, 4", "2, 2") + '[overhang]\nwidth = "2 um"\n'
    model = device(text, 'kind = "etched"\netch_radius = "15 um"')
    domain = mesh(model, symmetry, 0.8)
    whole = curves.area(model.edge_outline) - 4 * np.pi * 4e-12
    corners = domain.mesh.p[:, domain.mesh.t]
    (ax, ay) = corners[:, 1] - corners[:, 0]
    (bx, by) = corners[:, 2] - corners[:, 0]
    area = np.abs(ax * by - ay * bx) / 2  # of straight triangles, which miss the arcs
    assert domain.copies * area.sum() == pytest.approx(whole, rel=0.01)
    strip = (domain.mesh.subdomains or {})["overhang"]
    assert domain.copies * area[strip].sum() == pytest.approx(
        curves.area(model.edge_outline) - curves.area(model.outline), rel=0.03
    )
    assert set(domain.mesh.boundaries or {}) >= {"clamped", "free"}
