"""What holds for every device: areas, orientation, scaling, and one line for what is none."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from femnl.core.device import Model
from femnl.device.geometry import curves, parse
from femnl.device.mesh import mesh
from femnl.mechanics.fem.elements import Space
from femnl.pipeline import solve_modes

FEW = settings(derandomize=True, database=None, deadline=None, max_examples=12)
FILM = (
    '[film]\nthickness = "100 nm"\nyoung = "250 GPa"\npoisson = 0.23\ndensity = "3100 '
    'kg/m^3"\nstress = "1 '
    'GPa"\n[model]\nbending '
    "= false\n"
)


@st.composite
def outlines(draw: st.DrawFn) -> tuple[str, float]:
    """Draw an outline of any kind, and half the side [µm] of a square inside it."""
    size = draw(st.floats(20, 500))
    kind = draw(st.sampled_from(["square", "rectangle", "circle", "regular-polygon", "polygon"]))
    if kind == "square":
        return f'kind = "square"\nside = "{size} um"', size / 2
    if kind == "rectangle":
        ratio = draw(st.floats(1, 4))
        return f'kind = "rectangle"\nwidth = "{size * ratio} um"\nheight = "{size} um"', size / 2
    if kind == "circle":
        return f'kind = "circle"\ndiameter = "{size} um"', size / 2 / np.sqrt(2)
    if kind == "regular-polygon":
        sides = draw(st.integers(3, 12))
        return (
            f'kind = "regular-polygon"\nsides = {sides}\nlong_axis = "{size} um"',
            size / 2 * np.cos(np.pi / sides) / np.sqrt(2),
        )
    angles = np.sort(np.array(draw(st.lists(st.floats(0.05, 1), min_size=3, max_size=9))).cumsum())
    angles *= 2 * np.pi / angles[-1]
    if np.diff(angles, append=angles[0] + 2 * np.pi).max() > 0.9 * np.pi:
        angles = 2 * np.pi * np.arange(5) / 5
    corners = ", ".join(
        f'["{size / 2 * np.cos(a):.9f} um", "{size / 2 * np.sin(a):.9f} um"]' for a in angles
    )
    reach = size / 2 * np.cos(np.diff(angles, append=angles[0] + 2 * np.pi).max() / 2)
    return f'kind = "polygon"\npoints = [{corners}]', reach / np.sqrt(2)


@st.composite
def devices(draw: st.DrawFn) -> Model:
    """A device with or without a lattice of holes that fits into it."""
    outline, half = draw(outlines())
    holes = ""
    n = draw(st.integers(0, 3))
    if n:
        pitch = 2 * half / n
        radius = pitch * draw(st.floats(0.1, 0.35))
        holes = (
            f'[holes]\nlattice = "square"\npitch = "{pitch} um"\ncount = [{n}, {n}]\nradius '
            f'= "{radius} um"\n'
        )
    return parse(f'name = "any"\n[outline]\n{outline}\n{holes}{FILM}')


@given(devices(), st.sampled_from(["auto", "full"]))
@FEW
def test_a_mesh_covers_the_film_once_and_nothing_else(device: Model, symmetry: str) -> None:
    domain = mesh(device, symmetry)
    space = Space(domain.mesh, 2)
    points, weights = space.quadrature(8)
    determinant = np.linalg.det(space.jet(slice(None), points).jacobian)
    assert np.all(determinant * np.sign(determinant[:, :1]) > 0)
    covered = domain.copies * np.sum(np.abs(determinant) * weights)
    film = curves.area(device.outline) - len(device.holes.centres) * np.pi * device.holes.radius**2
    assert covered == pytest.approx(film, rel=1e-3)


@given(outlines(), st.floats(0.01, 100))
@settings(FEW, max_examples=4)
def test_a_membrane_of_another_size_rings_in_proportion(
    outline: tuple[str, float], factor: float
) -> None:
    device = parse(f'name = "any"\n[outline]\n{outline[0]}\n{FILM}')
    thinner = parse(device.text.replace('"3100 kg/m^3"', f'"{3100 * factor} kg/m^3"'))
    one, other = (
        solve_modes(d, 2, resolution=0.5, cache=False).frequency for d in (device, thinner)
    )
    np.testing.assert_allclose(other * np.sqrt(factor), one, rtol=1e-9)
