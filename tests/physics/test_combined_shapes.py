"""Films of combined shapes against closed forms, and the error bars that they are given."""

from pathlib import Path

import gdstk
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import jv, yv

import femnl
from femnl.core.device import Model
from femnl.device import geometry
from femnl.device.layout import import_layout, read_layers
from femnl.device.mesh import mesh
from femnl.mechanics.compression import released_stress
from tests.unit.layouts import write

Array = NDArray[np.float64]

FILM = (
    '[film]\nthickness = "1 um"\nyoung = "250 GPa"\npoisson = 0.23\ndensity = "1 kg/m^3"\n'
    'stress = "1 Pa"\n'
)
"""Its wave speed is 1 m/s."""


def device(tables: str, bending: bool = False) -> Model:
    model = f"[model]\nbending = {str(bending).lower()}\n"
    return geometry.parse(f'name = "any"\n{tables}\n{FILM}{model}')


def sector(degrees: float, inner: float = 0.0) -> str:
    """A sector of the unit disc from the x axis, without the disc of radius `inner`."""
    angles = np.radians(np.linspace(0, degrees, 2 + int(degrees // 80)))
    rays = [(2 * np.cos(a), 2 * np.sin(a)) for a in angles]
    points = ", ".join(f'["{x:.12f} m", "{y:.12f} m"]' for x, y in [(0.0, 0.0), *rays])
    parts = ['{shape = {kind = "circle", diameter = "2 m"}}']
    parts.append(f'{{shape = {{kind = "polygon", points = [{points}]}}, operation = "intersect"}}')
    if inner:
        hole = f'{{kind = "circle", diameter = "{2 * inner} m"}}'
        parts.append(f'{{shape = {hole}, operation = "subtract"}}')
    return f'[outline]\nkind = "combined"\nparts = [{", ".join(parts)}]'


def exact(degrees: float, inner: float, count: int) -> Array:
    """F of the sector: zeros of J_ν(k), or of J_ν(kb) Y_ν(k) − J_ν(k) Y_ν(kb), ν = nπ/β; /2π."""
    found: list[float] = []
    for n in range(1, 2 * count):
        order = n * 180 / degrees

        def level(k: float, order: float = order) -> float:
            if not inner:
                return float(jv(order, k))
            return float(jv(order, k * inner) * yv(order, k) - jv(order, k) * yv(order, k * inner))

        start = max(order * 0.9, 0.5)
        k = np.linspace(start, start + 40, 4000)
        values = np.array([level(x) for x in k])
        changes = np.flatnonzero(values[:-1] * values[1:] < 0)[:count]
        found += [float(brentq(level, k[j], k[j + 1], xtol=1e-13)) for j in changes]
    return np.sort(found)[:count] / (2 * np.pi)


@pytest.mark.parametrize(
    ("degrees", "inner", "within"),
    [
        (60, 0, 1e-6),
        (90, 0, 1e-6),
        (150, 0, 1e-5),
        (300, 0, 1e-4),
        (60, 0.4, 1e-6),
        (240, 0.5, 1e-6),
    ],
)
def test_sectors_have_the_zeros_of_bessel_functions(
    degrees: float, inner: float, within: float
) -> None:
    modes = femnl.solve_modes(device(sector(degrees, inner)), 6, cache=False)
    known = exact(degrees, inner, 6)
    error = np.abs(modes.frequency - known)
    assert (error / known).max() < within
    assert np.all(error <= modes.frequency_error)


def test_a_sector_drawn_in_gds_has_the_same_zeros(tmp_path: Path) -> None:
    drawn = gdstk.ellipse(
        (0, 0), 300, 120, initial_angle=0, final_angle=np.radians(240), tolerance=1e-3, layer=1
    )
    path = write(tmp_path / "a.gds", drawn)
    found = import_layout(path, read_layers("film=1/0"), geometry.load("circle"))
    text = found.text.replace("bending = true", "bending = false")
    model = geometry.parse(text)
    modes = femnl.solve_modes(model, 6, cache=False)
    speed = np.sqrt(model.film.stress / model.film.density) / 300e-6
    known = exact(240, 0.4, 6) * speed
    # Its corners are rounded to 1 nm of 180 µm of width
    np.testing.assert_allclose(modes.frequency, known, rtol=1e-5)


def test_two_halves_are_the_whole() -> None:
    half = '{shape = {kind = "rectangle", width = "1 m", height = "1 m"}, at = ["%s m", "0 m"]}'
    parts = ", ".join(half % x for x in ("-0.5", "0.5"))
    whole = device(f'[outline]\nkind = "combined"\nparts = [{parts}]')
    assert len(whole.outline.segments) == 4
    modes = femnl.solve_modes(whole, 3, cache=False)
    exactly = np.sqrt(np.array([1.25, 2.0, 3.25])) / 2
    np.testing.assert_allclose(modes.frequency, exactly, rtol=1e-7)


SQUARE = '[outline]\nkind = "square"\nside = "1 m"\n'
HOLE = '[[holes]]\nlattice = "list"\ncentres = [["0.1 m", "0.2 m"]]\n'
DISC = '{kind = "combined", parts = [{shape = {kind = "circle", diameter = "0.2 m"}}]}'


def test_a_round_hole_is_the_same_however_it_is_written() -> None:
    one, other = (
        femnl.solve_modes(device(f"{SQUARE}{HOLE}{shape}"), 4, cache=False)
        for shape in ('radius = "0.1 m"', f"shape = {DISC}")
    )
    error = one.frequency_error + other.frequency_error
    assert np.all(np.abs(one.frequency - other.frequency) <= error)
    np.testing.assert_allclose(one.frequency, other.frequency, rtol=1e-4)


@pytest.mark.parametrize(
    "shape",
    [
        pytest.param('{kind = "square", side = "0.2 m"}', marks=pytest.mark.slow),
        pytest.param(
            '{kind = "rectangle", width = "0.3 m", height = "0.1 m", fillet = "0.05 m"}',
            marks=pytest.mark.slow,
        ),
        '{kind = "regular-polygon", sides = 6, long_axis = "0.25 m", fillet = "0.03 m"}',
        '{kind = "spline", points = [["0.1 m", "0 m"], ["0 m", "0.06 m"], ["-0.1 m", "0 m"], '
        '["0 m", "-0.14 m"]]}',
    ],
)
def test_bars_of_films_with_drawn_holes_hold(shape: str) -> None:
    model = device(f'{SQUARE}{HOLE}angle = "20 deg"\nshape = {shape}')
    modes = femnl.solve_modes(model, 4, cache=False)
    finer = femnl.solve_modes(model, 4, resolution=1.6, degree=6, cache=False)
    assert np.all(np.abs(modes.frequency - finer.frequency) <= modes.frequency_error)
    assert (modes.frequency_error / modes.frequency).max() < 2e-3


def test_a_trampoline_is_solved_by_a_quarter_and_its_pairs_are_degenerate() -> None:
    pad = '{shape = {kind = "square", side = "60 um", fillet = "10 um"}, name = "pad"}'
    arm = '{shape = {kind = "rectangle", width = "%s", height = "%s"}, name = "tether"}'
    arms = [arm % ("600 um", "10 um"), arm % ("10 um", "600 um")]
    window = '{shape = {kind = "square", side = "500 um"}, operation = "intersect"}'
    parts = ", ".join([pad, *arms, window])
    outline = f'kind = "combined"\nfree = ["pad", "tether"]\nfillet = "5 um"\nparts = [{parts}]'
    film = FILM.replace("1 um", "200 nm").replace('"1 Pa"', '"1 GPa"').replace('"1 kg', '"3100 kg')
    model = geometry.parse(f'name = "t"\n[outline]\n{outline}\n{film}')
    assert sum(s.clamped for s in model.outline.segments) == 4
    modes = femnl.solve_modes(model, 3, cache=False)
    assert modes.domain.copies == 4
    # One of the lowest three is a pair, equal to the last digit
    gaps = np.diff(modes.frequency) / modes.frequency[0]
    assert gaps.min() < 1e-10


def test_stress_around_a_hole_is_that_of_kirsch() -> None:
    """Under tension S along x, a hole has −S at its rim where that faces the tension.

    Source: Timoshenko & Goodier, Theory of Elasticity (1970), section 35.
    """
    points = '["-10 m", "-2 m"], ["10 m", "-2 m"], ["10 m", "2 m"], ["-10 m", "2 m"]'
    strip = f'[outline]\nkind = "polygon"\nfree = [1, 3]\npoints = [{points}]\n'
    hole = '[holes]\nlattice = "list"\ncentres = [["0 m", "0 m"]]\nradius = "0.1 m"\n'
    stress = released_stress(mesh(device(strip + hole), resolution=2.0))
    middle = stress.corners.mean(axis=1)
    near = (np.hypot(*middle.T) < 0.3) & (np.hypot(*middle.T) > 0.12)
    pull = 1 - 0.23  # what a strip that may contract across keeps of the film stress
    expected = pull * kirsch(middle[near] / 0.1)
    assert np.abs(stress.least[near] - expected).max() < 0.03
    least, point = stress.worst
    assert least < -0.4
    assert abs(point[1]) < 0.05
    assert 0.1 < abs(point[0]) < 0.14


def kirsch(points: Array) -> Array:
    """The smaller principal stress beside a hole of radius 1 under tension 1 along x."""
    r = np.hypot(*points.T)
    angle = 2 * np.arctan2(points[:, 1], points[:, 0])
    radial = (1 - r**-2) / 2 + (1 - 4 * r**-2 + 3 * r**-4) / 2 * np.cos(angle)
    hoop = (1 + r**-2) / 2 - (1 + 3 * r**-4) / 2 * np.cos(angle)
    shear = -(1 + 2 * r**-2 - 3 * r**-4) / 2 * np.sin(angle)
    return np.asarray((radial + hoop) / 2 - np.hypot((radial - hoop) / 2, shear))
