"""The virtual laboratory itself: its films, fringes and sizes in σ against closed forms, and its files, from the seed alone."""

from pathlib import Path

import numpy as np
import pytest

from femnl import geometry
from femnl.optics import MultilayerFringe
from tests.blind.lab import Case, causes, make
from tests.blind.lab.film import membrane
from tests.blind.lab.maps import WAVELENGTH, reflection
from tests.blind.lab.spectrum import SpectrumBench

HEXAGON = np.array([7.155339133926055, 18.131677865531, 18.131677865531, 32.4518575144, 32.4518575144, 37.491352876798])
"""Eigenvalues of −Δ on the regular hexagon of side 1, from the literature that the validation case of the ideal hexagon cites."""


def test_the_laboratory_s_hexagon_has_the_eigenvalues_of_the_ideal_one() -> None:
    film = membrane("hexagon-278um", 0.0)
    assert film.square[:6] * film.half**2 == pytest.approx(HEXAGON, rel=2e-8)


def test_the_boundary_layer_of_a_square_plate_gives_its_published_frequencies() -> None:
    # Clamped square plate, Ta²/D = 10⁵: ω a² √(ρh/D) = 1414.0449 (Ritz and Argyris elements agree on it), ℓ/a = 10^−2.5.
    side = geometry.load("square-270um").outline.length
    layer = side / np.sqrt(1e5)
    k2 = float(membrane("square-270um", layer).clamped(layer).min())
    assert np.sqrt((k2 + layer**2 * k2**2) * 1e5) * side == pytest.approx(1414.0449, rel=2e-6)


def test_the_laboratory_s_stack_reflects_as_transfer_matrices_say() -> None:
    stack = geometry.load("square-270um").stack
    assert stack is not None
    u = np.linspace(-2e-7, 2e-7, 9)
    gap = stack.layers[stack.gap].thickness
    assert reflection(stack, gap + u) == pytest.approx(MultilayerFringe(stack, WAVELENGTH)(u), rel=1e-10)


@pytest.mark.parametrize("kind", ["spectrum", "map", "series"])
def test_causes_are_as_large_as_asked_for(kind: str, tmp_path: Path) -> None:
    for cause in causes(kind):
        sigma = make(Case(kind, (cause,), 5, size=(20.0, 20.1)), tmp_path / "file.nc")["sigma"][cause]
        assert sigma == pytest.approx(20, rel=0.35) or cause in ("multilayer_fringe", "finite_spot", "frame_mode"), cause


def test_a_uniform_change_of_all_frequencies_is_no_cause() -> None:
    rng = np.random.default_rng(4)
    bench = SpectrumBench("square-270um", True, rng)
    base = bench.draw(rng)
    faster, plain = bench.clean([(base | {"speed": 1.001 * base["speed"]}, {}), (base, {})])
    assert faster[:-1] / plain[:-1] == pytest.approx(np.full(bench.count, 1.001), rel=1e-12)


def test_a_seed_draws_the_same_file_again(tmp_path: Path) -> None:
    case = Case("spectrum", ("added_mass",), 9)
    assert make(case, tmp_path / "one.nc") == make(case, tmp_path / "two.nc")
    assert make(Case("spectrum", ("added_mass",), 10), tmp_path / "three.nc") != make(case, tmp_path / "two.nc")
