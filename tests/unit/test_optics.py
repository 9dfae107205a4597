"""The fringes f(u): transfer matrices against closed forms, and what a geometry may not ask for."""

import numpy as np
import pytest

from femnl.core.device import Layer, Stack
from femnl.core.errors import ParameterError
from femnl.optics.fringe import MultilayerFringe, SeriesFringe, SineFringe

RED = 632.8e-9
GREEN = 532e-9


def stack(
    film: complex = 2.0395,
    wafer: complex = 3.8640 - 0.0158j,
    thickness: float = 183.75e-9,
    gap: float = 3226.25e-9,
    between: complex = 1.0,
) -> Stack:
    """Vacuum, film, gap, wafer, with indices at the red wavelength."""
    indices = (1.0, film, between, wafer)
    layers = zip(
        ("vacuum", "SiN", "gap", "Si"), (np.inf, thickness, gap, np.inf), indices, strict=True
    )
    return Stack(tuple(Layer(name, d, ((RED, complex(n)),)) for name, d, n in layers), gap=2)


def airy(film: complex, wafer: complex, thickness: float, gap: float, wavelength: float) -> float:
    """Return R from Airy's sums over round trips, absorption as n − ik and time as exp(+iωt)."""

    def add(left: complex, right: complex, beneath: complex, d: float) -> complex:
        """Return the reflection at the boundary left|right in front of a layer of thickness d.

        The layer ends in the reflection `beneath`.
        """
        fresnel = (left - right) / (left + right)
        turn = beneath * np.exp(-4j * np.pi * right * d / wavelength)
        return complex((fresnel + turn) / (1 + fresnel * turn))

    bottom = (1 - wafer) / (1 + wafer)
    return abs(add(1, film, add(film, 1, bottom, gap), thickness)) ** 2


@pytest.mark.parametrize("seed", range(10))
def test_transfer_matrices_agree_with_the_recursion_of_airy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    film = rng.uniform(1.3, 3) - 1j * rng.uniform(0, 0.5)
    wafer = rng.uniform(1.3, 5) - 1j * rng.uniform(0, 2)
    thickness = rng.uniform(20e-9, 400e-9)
    gap = rng.uniform(1e-6, 5e-6)
    u = rng.uniform(-6e-7, 6e-7)
    fringe = MultilayerFringe(stack(film, wafer, thickness, gap), RED)
    assert fringe(u) == pytest.approx(airy(film, wafer, thickness, gap + u, RED), abs=2e-14)


def test_fourier_series_of_the_multilayer_fringe_agrees_with_transfer_matrices() -> None:
    fringe = MultilayerFringe(stack(), RED, gain=0.7, offset=-0.2)
    u = np.linspace(-3e-6, 3e-6, 41)
    assert fringe(u) == pytest.approx(
        np.array([-0.2 + 0.7 * fringe.reflectance(value) for value in u]), abs=1e-13
    )


def test_multilayer_fringe_repeats_after_half_a_wavelength_in_the_gap() -> None:
    fringe = MultilayerFringe(stack(between=1.33), RED)
    assert fringe.fourier.period == pytest.approx(RED / 2 / 1.33, rel=1e-15)
    assert fringe.reflectance(1e-8) == pytest.approx(
        fringe.reflectance(1e-8 + RED / 2 / 1.33), abs=1e-13
    )


def test_overtones_of_the_fringe_fall_by_the_product_of_the_two_mirrors() -> None:
    film = 2.0395
    wafer = 3.8640 - 0.0158j
    d = 183.75e-9
    fresnel = (1 - film) / (1 + film)
    turn = np.exp(-4j * np.pi * film * d / RED)
    mirror = -fresnel * (1 - turn) / (1 - fresnel**2 * turn)
    coefficients = MultilayerFringe(stack(film, wafer, d), RED).fourier.coefficients
    ratio = np.abs(coefficients[2:9] / coefficients[1:8])
    assert ratio == pytest.approx(np.full(7, abs(mirror * (1 - wafer) / (1 + wafer))), rel=1e-9)


def test_half_wave_film_vanishes() -> None:
    n = 2.0395
    fringe = MultilayerFringe(stack(film=n, wafer=3.864, thickness=RED / 2 / n), RED)
    assert fringe(np.linspace(0, RED, 9)) == pytest.approx(
        np.full(9, ((3.864 - 1) / (3.864 + 1)) ** 2), abs=1e-14
    )


def test_quarter_wave_film_on_the_wafer_reflects_by_the_textbook_formula() -> None:
    n = 2.0395
    wafer = 3.864
    fringe = MultilayerFringe(stack(film=n, wafer=wafer, thickness=RED / 4 / n, gap=RED / 2), RED)
    assert fringe(0.0) == pytest.approx(((wafer - n**2) / (wafer + n**2)) ** 2, abs=1e-14)


def test_sine_fringe_has_the_responsivity_of_the_paper() -> None:
    fringe = SineFringe(RED, 0.3, 0.2, 0.7)
    slope = (fringe(1e-12) - fringe(-1e-12)) / 2e-12
    assert slope == pytest.approx(-4 * np.pi * 0.2 * np.sin(0.7) / RED, rel=1e-8)


def test_fourier_series_of_the_sine_fringe_is_the_sine_fringe() -> None:
    fringe = SineFringe(GREEN, 0.3, 0.2, 2.1)
    u = np.linspace(-1e-6, 1e-6, 17)
    assert fringe.fourier(u) == pytest.approx(fringe(u), abs=1e-15)


def test_series_fringe_is_its_polynomial() -> None:
    assert SeriesFringe((1.0, 2e6, -3e12))([0.0, 1e-6]) == pytest.approx([1.0, 0.0])


def test_unlisted_wavelength_is_refused_with_the_listed_ones() -> None:
    with pytest.raises(
        ParameterError, match=r"no index of vacuum at 780 nm: the stack lists 632\.8 nm"
    ):
        MultilayerFringe(stack(), 780e-9)


def test_absorbing_gap_is_refused() -> None:
    with pytest.raises(ParameterError, match="absorbing gap"):
        MultilayerFringe(stack(between=1 - 0.01j), RED)


def test_a_geometry_without_a_stack_is_refused() -> None:
    with pytest.raises(
        ParameterError, match=r"the geometry gives no stack of layers; add \[readout\]"
    ):
        MultilayerFringe(None, RED)


def test_gap_outside_the_stack_is_refused() -> None:
    with pytest.raises(ParameterError, match="gap = 3 is not an inner layer"):
        MultilayerFringe(Stack(stack().layers, gap=3), RED)


@pytest.mark.parametrize("wavelength", [0.0, -RED, np.nan, np.inf])
def test_wavelength_must_be_a_length(wavelength: float) -> None:
    with pytest.raises(ParameterError, match="wavelength = "):
        SineFringe(wavelength, 0.0, 1.0, 0.0)
