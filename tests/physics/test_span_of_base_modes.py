"""How far the base modes span a film under other stress: closed forms and full expansions."""

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh

from femnl.core.stages import ModalSystem
from femnl.device.geometry import parse
from femnl.effects import library
from femnl.observe.film import SimulatedFilm
from tests.physics.changed_films import system_of
from tests.physics.test_tension_gradient import SQUARE, polynomials, relaxed_bowl
from tests.unit.test_diagnose_films import sheared

Array = NDArray[np.float64]
COUNT = 48
LOWEST = 14


@cache
def plain() -> ModalSystem:
    return system_of(SimulatedFilm(parse(SQUARE), COUNT))


def lowest(effect: str, values: dict[str, float]) -> Array:
    """Return frequencies over that of the unchanged film's first mode."""
    system = library()[effect].changes["operators"](plain(), values)
    square = eigh(system.stiffness, system.mass, eigvals_only=True)
    return np.asarray(np.sqrt(square[:LOWEST] * plain().mass[0, 0] / plain().stiffness[0, 0]))


@pytest.mark.parametrize(
    ("effect", "values", "squares"),
    [
        ("stress_anisotropy", {"anisotropy": 0.2}, (1.1, 0.9)),
        ("aspect_ratio", {"elongation": 0.1}, (1.05**-2, 1.05**2)),
    ],
)
def test_sines_stay_sines_at_the_strongest_stretch(
    effect: str, values: dict[str, float], squares: tuple[float, float]
) -> None:
    m = np.arange(1, 15)
    exact = np.sort(np.sqrt(np.add.outer(*(s * m**2 / 2 for s in squares)).ravel()))[:LOWEST]
    assert lowest(effect, values) == pytest.approx(exact, rel=1e-7)


@pytest.mark.parametrize(("shear", "error"), [(0.1, 1.6e-4), (0.03, 1.7e-5), (0.01, 2e-6)])
def test_shear_is_as_many_more_sines_give_it(shear: float, error: float) -> None:
    for sign in (1, -1):
        found = lowest("shear_stress", {"shear": sign * shear})
        assert found == pytest.approx(sheared(shear, 30)[0][:LOWEST], rel=error)


@pytest.mark.parametrize(("bowl", "error"), [(0.1, 1e-5), (0.02, 1e-6)])
def test_a_bowl_is_as_many_polynomials_give_it(bowl: float, error: float) -> None:
    terms = 18
    _, w, value, slope = polynomials(terms)
    mass, stiff = (value * w) @ value.T, (slope * w) @ slope.T
    root = np.sqrt(np.outer(w, w)).ravel()
    dx = np.einsum("mx,ny->mnxy", slope, value).reshape(terms**2, -1) * root
    dy = np.einsum("mx,ny->mnxy", value, slope).reshape(terms**2, -1) * root
    xx, yy, xy = (bowl * part.ravel() for part in relaxed_bowl(16))
    mixed = (xy * dx) @ dy.T
    stiffness = np.kron(stiff, mass) + np.kron(mass, stiff)
    stiffness += (xx * dx) @ dx.T + (yy * dy) @ dy.T + mixed + mixed.T
    square = eigh(stiffness, np.kron(mass, mass), eigvals_only=True)[:LOWEST]
    exact = np.sqrt(square * 2) / np.pi
    found = lowest("tension_gradient", {"slope_x": 0.0, "slope_y": 0.0, "bowl": bowl})
    assert found == pytest.approx(exact, rel=error)
