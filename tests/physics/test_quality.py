"""Quality factors in absolute terms against closed forms."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from femnl.core.device import Film, Model
from femnl.core.errors import ParameterError
from femnl.core.loss import Loss
from femnl.core.modes import Modes
from femnl.device.geometry import parse
from femnl.mechanics.modes.quality import solve_quality
from femnl.pipeline import solve_modes

Device = Callable[..., Model]
SIDE = 500e-6
SQUARE = """
name = "square"
[outline]
kind = "square"
side = "500 um"
[film]
thickness = "50 nm"
young = "270 GPa"
poisson = 0.27
density = "2700 kg/m^3"
stress = "0.9 GPa"
"""
# Yu, Purdy and Regal: λ = 2ℓ/L, ℓ² = Eh²/12(1 − ν²)σ
LAMBDA = 2 * np.sqrt(270e9 * 50e-9**2 / (12 * (1 - 0.27**2) * 0.9e9)) / SIDE


@pytest.fixture(scope="module")
def modes() -> Modes:
    return solve_modes(parse(SQUARE), 4, cache=False)


def test_a_square_of_silicon_nitride_has_the_q_of_the_published_formulas(modes: Modes) -> None:
    # Villanueva and Schmid: Q_int = 1/(1/28000 + 1/(6e10 · 50e-9)) = 2710, and for β = 2e10 and
    # 10e10 they give 966 and 4242; diluted by 1/(λ + λ²π²(m² + n²)/4) but for a share λ of that.
    found = solve_quality(modes)
    assert found.intrinsic == pytest.approx((2709.677, 965.517, 4242.424), rel=1e-6)
    squares = np.array([2, 5, 5, 8])
    diluted = 1 / (LAMBDA + LAMBDA**2 * np.pi**2 * squares / 4)
    np.testing.assert_allclose(found.total, 2709.677 * diluted, rtol=2 * LAMBDA + 0.01)
    assert np.all(found.gas == np.inf)
    assert np.all((found.low < 0.36 * found.total) & (found.high > 1.56 * found.total))


def test_thin_gas_takes_what_its_molecules_carry_off(modes: Modes) -> None:
    # Christian 1966 for both sides: Q_gas = (π/2)^{3/2} ρhf √(RT/M)/p, at 1 Pa of nitrogen
    pressure = 1.0
    thermal = np.sqrt(8.314462618 * 295 / 0.0280134)
    expected = (np.pi / 2) ** 1.5 * 2700 * 50e-9 * modes.frequency * thermal / pressure
    vacuum = solve_quality(modes)
    found = solve_quality(modes, pressure)
    np.testing.assert_allclose(found.gas, expected, rtol=1e-9)
    np.testing.assert_allclose(1 / found.total, 1 / vacuum.total + 1 / expected, rtol=1e-12)
    assert np.all(found.low < found.total)
    assert np.all(found.high > found.total)


def test_a_lossless_surface_leaves_the_volume(modes: Modes) -> None:
    model = replace(modes.domain.model, loss=Loss(5000.0, 1e30, 0.0))
    bare = replace(
        modes, prestress=replace(modes.prestress, domain=replace(modes.domain, model=model))
    )
    assert solve_quality(bare).intrinsic == pytest.approx((5000.0,) * 3)


def test_what_has_no_one_thickness_is_refused_in_one_line(modes: Modes) -> None:
    film: Film = replace(modes.domain.model.film, gradient=(1e-6, 0.0))
    model = replace(modes.domain.model, film=film)
    uneven = replace(
        modes, prestress=replace(modes.prestress, domain=replace(modes.domain, model=model))
    )
    with pytest.raises(ParameterError, match="this film is uneven; ask for its dissipation"):
        solve_quality(uneven)
    with pytest.raises(ParameterError, match="expected 0 or more"):
        solve_quality(modes, -1.0)


def test_a_geometry_says_what_its_film_loses() -> None:
    words = SQUARE + '[loss]\nvolume = 20000\nsurface = "7e10 m^-1"\nsurface_error = "1e10 m^-1"\n'
    assert parse(words).loss == Loss(20000, 7e10, 1e10)
    assert parse(SQUARE).loss == Loss()
    assert parse(SQUARE + '[loss]\nsurface = "7 /nm"\n'.replace("7 /nm", "70 um^-1")).loss == Loss(
        2.8e4, 7e7, 0.0
    )
