"""An undercut strip of the frame around a film, against closed forms of joined films.

The error bars of such devices hold.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import jn_zeros

from femnl.core.device import Clamp, Film, Model, Overhang
from femnl.device.mesh import mesh
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import cells
from femnl.mechanics.prestress import solve_prestress
from femnl.pipeline import solve_modes as solve_device
from tests.physics.elastic_films import (
    CIRCLE,
    DENSITY,
    ORDERS,
    POISSON,
    SQUARE,
    STRESS,
    TENSION,
    THICKNESS,
    Array,
    Device,
    elastic,
    everywhere,
    first_root,
    plate_on_springs,
    solve,
    squares,
    traces,
    waves,
)


def undercut(model: Model, width: float, other: Film | None = None) -> Model:
    """The device with a strip of its own film, or of another, around its circle or square."""
    outer = model.outline
    grown = tuple(
        replace(
            s,
            start=tuple(np.multiply(s.start, 1 + width)),
            end=tuple(np.multiply(s.end, 1 + width)),
        )
        for s in outer.segments
    )
    return replace(
        model, overhang=Overhang(width, replace(outer, segments=grown), other or model.film)
    )


@pytest.mark.parametrize(
    ("outline", "exact"),
    [(CIRCLE, [jn_zeros(n, 1)[0] for n in ORDERS]), (SQUARE, np.pi * np.sqrt([2, 5, 5, 8]) / 2)],
)
@pytest.mark.parametrize("symmetry", ["auto", "half"])
def test_an_overhang_of_the_film_is_more_film(
    device: Device, outline: str, exact: Array, symmetry: str
) -> None:
    modes = solve(undercut(elastic(device, outline), 0.25), symmetry=symmetry, resolution=1)
    np.testing.assert_allclose(squares(modes), (np.array(exact) / 1.25) ** 2, rtol=1e-9)


def test_film_and_overhang_of_different_stress_share_lames_displacement(device: Device) -> None:
    inner = elastic(device)
    other = replace(inner.film, thickness=0.03, stress=2e9, young=4e10, poisson=0.1)
    model = undercut(inner, 0.5, other)
    # Inside u = a r, in the overhang u = c (r − R²/r) with R = 1.5, which does not move at its rim.
    wide = other.young / (1 - other.poisson)
    deviating = other.young / (1 + other.poisson)
    matrix = [
        [1, -(1 - 2.25)],
        [THICKNESS * 1e11 / (1 - POISSON), -other.thickness * (wide + 2.25 * deviating)],
    ]
    a, c = np.linalg.solve(matrix, [0, other.thickness * other.stress - TENSION])
    radius, stress = everywhere(solve_prestress(mesh(model, "auto", 2), 6))
    inside = radius < 1
    np.testing.assert_allclose(stress[inside, 0], STRESS + 1e11 / (1 - POISSON) * a, rtol=1e-6)
    np.testing.assert_allclose(stress[~inside, 0], other.stress + wide * c, rtol=1e-6)
    np.testing.assert_allclose(
        stress[~inside, 1], abs(deviating * c) * 2.25 / radius[~inside] ** 2, rtol=1e-6
    )


def two_plates(
    order: int,
    layers: tuple[float, float],
    density: float,
    rim: float,
    poisson: float,
    rigidity: float,
) -> float:
    """(ω/c)² of a disc of radius 1 within a clamped ring.

    One tension, two masses (1 and `density`), rigidities (1 and `rigidity`).
    """
    inner = (layers[0], POISSON)
    outer = (layers[1], poisson)

    def miss(root: float) -> float:
        columns = []
        for kind, wave in zip("JI", waves(root**2, layers[0]), strict=True):
            columns.append(np.concatenate([traces(kind, order, wave, 1.0, inner), [0, 0]]))
        first, second = waves(root**2 * density, layers[1])
        for kind, wave in (("J", first), ("Y", first), ("I", second), ("K", second)):
            here = traces(kind, order, wave, 1.0, outer) * [1, 1, rigidity, rigidity]
            columns.append(np.concatenate([-here, traces(kind, order, wave, rim, outer)[:2]]))
        matrix = np.array(columns)
        return float(np.linalg.det(matrix / np.abs(matrix).max(axis=1, keepdims=True)))

    return first_root(miss) ** 2


def test_a_plate_and_its_thicker_overhang_vibrate_as_two_joined_plates(device: Device) -> None:
    layer = 0.05
    inner = elastic(device, layer=layer)
    # Four times as thick at a quarter of the stress, so that the tension is the same.
    model = undercut(
        inner,
        0.2,
        replace(
            inner.film, thickness=4 * THICKNESS, stress=STRESS / 4, density=DENSITY / 2, poisson=0.1
        ),
    )
    rigidity = 64 * (1 - POISSON**2) / (1 - 0.1**2)
    exact = [
        two_plates(order, (layer, layer * np.sqrt(rigidity)), 2.0, 1.2, 0.1, rigidity)
        for order in ORDERS
    ]
    np.testing.assert_allclose(squares(solve(model, resolution=1)), exact, rtol=1e-6)


def test_the_overhang_is_a_film_of_its_own(device: Device) -> None:
    model = undercut(elastic(device), 0.5)
    domain = mesh(model, "quarter", 1)
    strip = np.isin(np.arange(domain.mesh.nelements), (domain.mesh.subdomains or {})["overhang"])
    areas = np.concatenate([cell.dx.sum(axis=1) for cell in cells(Space(domain.mesh, 4), 4)])
    assert 4 * areas[strip].sum() == pytest.approx(np.pi * (1.5**2 - 1), rel=1e-6)
    assert 4 * areas[~strip].sum() == pytest.approx(np.pi, rel=1e-6)


@pytest.mark.parametrize("resolution", [0.6, 1.0])
def test_error_bars_hold_where_edges_give_way_and_overhang(
    device: Device, resolution: float
) -> None:
    clamp = Clamp(deflection=3e8, rotation=1e5)
    layer = 0.05
    rigidity = 64 * (1 - POISSON**2) / (1 - 0.1**2)
    inner = elastic(device, layer=layer)
    thick = undercut(
        inner,
        0.2,
        replace(
            inner.film, thickness=4 * THICKNESS, stress=STRESS / 4, density=DENSITY / 2, poisson=0.1
        ),
    )
    cases = [
        (
            elastic(device, layer=0.1, clamp=clamp),
            [plate_on_springs(order, 0.1, clamp) for order in ORDERS],
        ),
        (
            thick,
            [
                two_plates(order, (layer, layer * np.sqrt(rigidity)), 2.0, 1.2, 0.1, rigidity)
                for order in ORDERS
            ],
        ),
    ]
    for model, exact in cases:
        modes = solve_device(model, 4, resolution=resolution, cache=False)
        found = np.sqrt(squares(modes))
        known = np.sqrt(exact)
        assert np.all(np.abs(found / known - 1) <= modes.frequency_error / modes.frequency)
        assert np.all(
            np.abs(modes.ratio * known[0] / known - 1) <= (modes.ratio_error / modes.ratio) + 1e-15
        )
        assert np.all(modes.frequency_error < 1e-3 * modes.frequency)


@pytest.mark.parametrize("resolution", [0.6, 1.0])
def test_error_bars_hold_where_corners_make_the_stress_uneven(
    device: Device, resolution: float
) -> None:
    model = elastic(device, SQUARE, clamp=Clamp(normal=1e8, shear=1e8))
    known = solve(model, 3, resolution=1.6)
    modes = solve_device(model, 3, resolution=resolution, cache=False)
    assert np.all(np.abs(modes.frequency - known.frequency) <= modes.frequency_error)
    assert np.all(modes.frequency_error < 1e-5 * modes.frequency)
