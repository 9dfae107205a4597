"""Harmonic maps of simulated mode shapes: predicted by one mesh, fitted by another."""

from pathlib import Path

import numpy as np
import pytest

import femnl
from femnl.core.modes import Modes
from femnl.core.readout import Array
from femnl.fits.map.fit import fit_map
from femnl.io.measurement import harmonic_map, read
from femnl.mechanics.modes import shape_at
from femnl.observe.map.forward import Shape
from femnl.optics.fringe import SineFringe
from femnl.optics.harmonics import harmonics

RED = 632.8e-9
DATA = Path(__file__).parents[3] / "shared" / "data"


def shape_of(modes: Modes) -> Shape:
    """The fundamental mode as a function of points."""

    def shape(x: Array, y: Array) -> Array:
        return shape_at(modes, 0, x, y)

    return shape


def test_hexagon_at_the_depth_of_the_paper_gives_back_its_212_nanometres() -> None:
    shape = shape_of(femnl.solve_modes(femnl.load("hexagon-278um"), count=1))
    U = 4.218 * RED / (4 * np.pi)
    axis = np.linspace(-160e-6, 160e-6, 41)
    rng = np.random.default_rng(3)
    x, y = np.meshgrid(axis - 5e-6, axis + 7e-6)
    c = np.cos(0.06)
    s = np.sin(0.06)
    V = harmonics(
        SineFringe(RED, 0.0, 0.02, 1.0), range(1, 7), U * shape(c * x + s * y, c * y - s * x), 0.3
    )
    V = V + 2e-4 * (rng.normal(size=V.shape) + 1j * rng.normal(size=V.shape))
    found = fit_map(
        harmonic_map(axis, axis, range(1, 7), V, noise_sd=2e-4, wavelength=RED), shape
    ).fit
    truth = {
        "amplitude": U,
        "contrast": 0.02,
        "fringe_phase": 1.0,
        "motion_phase": 0.3,
        "x": 5e-6,
        "y": -7e-6,
        "scale": 1.0,
        "rotation": 0.06,
    }
    for name, value in truth.items():
        assert abs(found[name] - value) < 4 * found.parameters[name].sd, name
    assert found["amplitude"] == pytest.approx(212.4e-9, abs=0.5e-9)
    assert found.chi2_reduced == pytest.approx(1, abs=0.04)


@pytest.mark.slow
@pytest.mark.shared
@pytest.mark.skipif(not DATA.exists(), reason="../shared/data is not there")
def test_clamped_edge_of_the_simulated_shape_brings_the_size_of_the_shared_map_to_one() -> None:
    model = femnl.load("square-270um")
    data = read(DATA / "open-map-null.nc")["map"].to_dataset()
    found = fit_map(data, shape_of(femnl.solve_modes(model, count=1))).fit
    side = model.outline.length

    def ideal(x: Array, y: Array) -> Array:
        inside = (np.abs(x) < side / 2) & (np.abs(y) < side / 2)
        return np.where(inside, np.cos(np.pi * x / side) * np.cos(np.pi * y / side), 0.0)

    without_bending = fit_map(data, ideal).fit
    film = model.film
    boundary = np.sqrt(film.young * film.thickness**2 / (12 * (1 - film.poisson**2) * film.stress))
    assert abs(found["scale"] - 1) < 4 * found.parameters["scale"].sd
    assert without_bending["scale"] == pytest.approx(1 - 2 * boundary / side, abs=5e-4)
    assert abs(found["amplitude"] - 3.1341581347821576e-07) < 3 * found.parameters["amplitude"].sd
