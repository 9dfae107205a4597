"""Films that layers bend at rest, what layers lose, and their bands: closed forms of laminates."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad, solve_bvp
from scipy.special import iv, jn_zeros, jv

from femnl.cli._main import run
from femnl.core.device import Model
from femnl.core.errors import ParameterError
from femnl.device.geometry import parse
from femnl.mechanics.bands import Lattice, solve_bands
from femnl.mechanics.fem.offset import own_moment
from femnl.mechanics.modes.dilution import dilution
from femnl.mechanics.modes.quality import solve_quality
from femnl.mechanics.static_deflection import solve_static_deflection
from femnl.pipeline import solve_modes

Array = NDArray[np.float64]
RADIUS = 50e-6
NU = 0.23
YOUNG = np.array([250e9, 70e9])
SIZE = np.array([100e-9, 80e-9])
MASS = 3000 * 100e-9 + 2700 * 80e-9
HEIGHT = np.array([0.0, 90e-9])
NEUTRAL = (YOUNG * SIZE) @ HEIGHT / (YOUNG @ SIZE)
LEVER = YOUNG * (SIZE**3 / 12 + SIZE * (HEIGHT - NEUTRAL) ** 2)
"""E I by width of film and metal about their neutral plane [N m]; over 1 − ν² their rigidity."""
RIGIDITY = LEVER.sum() / (1 - NU**2)
DISC = '[outline]\nkind = "circle"\ndiameter = "100 um"\n'
SQUARE = '[outline]\nkind = "square"\nside = "100 um"\n'
HINGED = '[clamp]\nrotation = "0 N"\n'


def stresses(tension: float, moment: float) -> Array:
    """Stresses of film and metal [Pa] for a tension [N/m] and a moment about the middle [N]."""
    return np.linalg.solve(np.stack([SIZE, SIZE * (HEIGHT - NEUTRAL)]), [tension, moment])


def laminate(
    outline: str, stress: Array, *, poisson: float = NU, more: str = "", metal: str = ""
) -> Model:
    """A film of 100 nm with 80 nm of metal all over it."""
    return parse(
        f'name = "laminate"\n{outline}[film]\nthickness = "100 nm"\nyoung = "250 GPa"\n'
        f'poisson = {poisson}\ndensity = "3000 kg/m^3"\nstress = "{float(stress[0])!r} Pa"\n{more}'
        f'[[layers]]\nname = "metal"\nthickness = "80 nm"\nyoung = "70 GPa"\npoisson = {poisson}\n'
        f'density = "2700 kg/m^3"\nstress = "{float(stress[1])!r} Pa"\n{metal}'
    )


def rest(model: Model) -> float:
    """The largest deflection at rest [m]."""
    return solve_static_deflection(solve_modes(model, 1, cache=False)).depth


@pytest.mark.parametrize("stretched", [0.5, 3.0, 20.0])
def test_a_hinged_drum_bends_as_bessels_functions_say(stretched: float) -> None:
    """T Δw = D ΔΔw, w = 0 and D(w″ + νw′/r) = M at the edge: w = C(I₀(kr) − I₀(ka))."""
    tension = RIGIDITY * (stretched / RADIUS) ** 2
    small = 1e-6 * RIGIDITY / RADIUS
    model = laminate(DISC, stresses(tension, small), more=HINGED)
    assert own_moment(model) == pytest.approx(small, rel=1e-9, abs=0)
    factor = iv(0, stretched) - (1 - NU) * iv(1, stretched) / stretched
    exact = small / (tension * factor) * (1 - iv(0, stretched))
    assert rest(model) == pytest.approx(exact, rel=1e-6, abs=0)


def test_springs_of_an_edge_take_up_a_part_of_the_moment() -> None:
    """D(w″ + νw′/r) = M − k w′ at the edge, with k = 3 D/R; exact to rounding as a quartic is."""
    small = 1e-6 * RIGIDITY / RADIUS
    spring = float(3 * RIGIDITY / RADIUS)
    more = f'[clamp]\nrotation = "{spring!r} N"\n'
    model = laminate(DISC, stresses(1e-9, -small), more=more)
    # Without tension w = c (r² − R²)/2, of the curvature c = M/(D(1 + ν) + kR)
    curvature = small / (RIGIDITY * (1 + NU) + spring * RADIUS)
    assert rest(model) == pytest.approx(curvature * RADIUS**2 / 2, rel=1e-6, abs=0)


def test_a_drum_without_tension_has_timoshenkos_curvature() -> None:
    """The curvature of a bimetal, J. Opt. Soc. Am. 11, 233 (1925), with the moduli E/(1 − ν)."""
    stress = stresses(1e-9, -1e-12)
    strain = stress * (1 - NU) / YOUNG
    m = SIZE[0] / SIZE[1]
    n = YOUNG[0] / YOUNG[1]
    misfit = 6 * (strain[1] - strain[0]) * (1 + m) ** 2
    curvature = misfit / (SIZE.sum() * (3 * (1 + m) ** 2 + (1 + m * n) * (m**2 + 1 / (m * n))))
    # A metal that pushes on top draws the rim down, so that the middle lies above it
    assert rest(laminate(DISC, stress, more=HINGED)) == pytest.approx(
        -curvature * RADIUS**2 / 2, rel=1e-5, abs=0
    )


def test_a_drum_bent_by_its_thickness_obeys_von_karman() -> None:
    """Axially symmetric plate, by collocation: D(φ′ + φ/r)′ = Nφ, (rN_r)′ = N_θ, φ = w′."""
    tension = 4 * RIGIDITY / RADIUS**2
    moment = -1e-2 * RIGIDITY / RADIUS
    stiffness = float(YOUNG @ SIZE) / (1 - NU**2)
    strain = tension / stiffness

    # In units of R, with y = u/R, u′, φ, φ′, w/R
    def slopes(r: Array, y: Array) -> Array:
        u, du, turn, bend, _ = y
        pull = stiffness * (strain + du + turn**2 / 2 + NU * u / r)
        second = turn / r**2 - bend / r + pull * RADIUS**2 / RIGIDITY * turn
        in_plane = -(du / r - u / r**2) - turn * bend - (1 - NU) / 2 * turn**2 / r
        return np.array([du, in_plane, bend, second, turn])

    def ends(a: Array, b: Array) -> Array:
        hinge = b[3] + NU * b[2] - moment * RADIUS / RIGIDITY
        return np.array([a[0], a[2], b[0], hinge, b[4]])

    r = np.linspace(1e-6, 1, 400)
    found = solve_bvp(slopes, ends, r, np.zeros((5, r.size)), tol=1e-8, max_nodes=100_000)
    assert found.success
    exact = float(found.y[4, 0]) * RADIUS
    linear = moment / tension / (iv(0, 2) - (1 - NU) * iv(1, 2) / 2) * (1 - iv(0, 2))
    assert abs(exact / linear) < 0.8
    model = laminate(DISC, stresses(tension, moment), more=HINGED)
    assert rest(model) == pytest.approx(exact, rel=1e-4, abs=0)


def strip(length: float, free: str) -> str:
    """A strip 10 µm wide between its first and third side, which are 10 µm long."""
    points = f'[["0 um", "-5 um"], ["0 um", "5 um"], ["{length} um", "5 um"], ["{length} um", '
    return f'[outline]\nkind = "polygon"\npoints = {points}"-5 um"]]\nfree = {free}\n'


def test_a_cantilever_has_stoneys_curvature_far_from_its_clamp() -> None:
    """ν = 0 and no tension: w″ = M/D; what the clamp does is linear in the length."""
    moment = -1e-6 * LEVER.sum() / 100e-6
    stress = stresses(0.0, moment)
    depths = [rest(laminate(strip(x, "[2, 3, 4]"), stress, poisson=0.0)) for x in (40, 50, 60)]
    curvature = float(np.diff(depths, 2)[0]) / (10e-6) ** 2
    assert curvature == pytest.approx(moment / LEVER.sum(), rel=2e-4, abs=0)


def test_a_laminated_beam_has_the_frequencies_of_its_closed_form() -> None:
    """Held at both ends, free at its sides, ν = 0: ω = (4.730041/L)² √(ΣEI/Σρh)."""
    beam = laminate(strip(100, "[2, 4]"), stresses(0.0, -1e-14), poisson=0.0)
    modes = solve_modes(beam, 1, cache=False)
    exact = (4.730040744862704 / 100e-6) ** 2 * np.sqrt(LEVER.sum() / MASS) / (2 * np.pi)
    assert modes.frequency[0] == pytest.approx(exact, rel=1e-5, abs=0)


def test_a_clamped_film_that_layers_cover_evenly_stays_flat() -> None:
    model = laminate(SQUARE, np.array([1e9, -2e8]))
    assert own_moment(model) < 0
    modes = solve_modes(model, 2, cache=False)
    found = solve_static_deflection(modes)
    assert found.depth == 0
    assert found.frequency == pytest.approx(modes.frequency, rel=1e-9, abs=0)
    assert np.abs(found.k2).max() == 0


def test_layers_and_pressure_bend_together() -> None:
    tension = RIGIDITY * (3 / RADIUS) ** 2
    moment = 1e-6 * RIGIDITY / RADIUS
    modes = [
        solve_modes(laminate(DISC, stresses(tension, m), more=HINGED), 1, cache=False)
        for m in (moment, 0.0)
    ]
    both = solve_static_deflection(modes[0], pressure=1e-3).depth
    apart = [solve_static_deflection(modes[0]), solve_static_deflection(modes[1], pressure=1e-3)]
    assert both == pytest.approx(sum(one.depth for one in apart), rel=1e-6, abs=0)


def test_a_rest_without_bending_is_refused() -> None:
    flat = laminate(DISC, np.array([1e9, 1e8]), more="[model]\nbending = false\n")
    with pytest.raises(ParameterError, match="bending = false leaves layers no lever"):
        solve_static_deflection(solve_modes(flat, 1, cache=False))


def test_the_command_line_bends_a_film_by_its_layers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    tension = RIGIDITY * (3 / RADIUS) ** 2
    model = laminate(DISC, stresses(tension, 1e-4 * RIGIDITY / RADIUS), more=HINGED)
    path = tmp_path / "hinged.toml"
    path.write_text(model.text, encoding="utf-8")
    assert run(["modes", str(path), "--count", "1", "--bow", "layers"]) == 0
    assert "Bent at rest by -" in capsys.readouterr().out.replace("−", "-")
    assert "(--bow layers)" in caplog.text
    assert run(["modes", "square-270um", "--count", "1", "--bow", "layers"]) == 2
    assert "give either its depth" in capsys.readouterr().err


QUALITY = "quality_factor = 400.0\n"


def test_an_even_laminate_loses_by_the_rigidity_of_each_layer() -> None:
    """1/Q = Σ fᵢ/(QᵢD), fᵢ = EᵢIᵢ/ΣEI about the neutral plane."""
    modes = solve_modes(laminate(SQUARE, np.array([1e9, 1e8]), metal=QUALITY), 3, cache=False)
    found = solve_quality(modes)
    part = LEVER / LEVER.sum()
    own = modes.domain.model.loss.intrinsic(100e-9)[0]
    factor = dilution(modes)[0]
    assert found.lost[0] == pytest.approx(
        part[0] / own / (part[0] / own + part[1] / 400), rel=1e-9, abs=0
    )
    assert found.total == pytest.approx(factor / (part[0] / own + part[1] / 400), rel=1e-9, abs=0)
    assert np.all((found.low < found.total) & (found.total < found.high))


def test_layers_as_good_as_the_film_change_nothing_but_the_dilution() -> None:
    """Unlike ratios of Poisson and a pad: the parts still sum to what bends."""
    own = 1 / (1 / 2.8e4 + 1 / 6e3)
    metal = f'quality_factor = {own!r}\nshape = {{kind = "circle", diameter = "40 um"}}\n'
    text = laminate(DISC, np.array([1e9, 1e8]), metal=metal).text
    model = parse(text.replace('poisson = 0.23\ndensity = "2700', 'poisson = 0.4\ndensity = "2700'))
    assert model.layers[0].poisson == 0.4
    modes = solve_modes(model, 3, cache=False)
    assert solve_quality(modes).total == pytest.approx(own * dilution(modes)[0], rel=1e-9, abs=0)


@pytest.mark.slow
def test_a_soft_pad_loses_what_the_curvature_of_the_drum_under_it_stores() -> None:
    """Under so soft and light a pad the drum keeps J₀(kr): part ∫ κ : D : κ over the pad."""
    metal = QUALITY + 'shape = {kind = "circle", diameter = "40 um"}\n'
    text = laminate(DISC, np.array([1e9, 0.0]), metal=metal).text
    for before, after in (('"70 GPa"', '"70 kPa"'), ('"2700 kg', '"0.01 kg'), ("250 GPa", "1 GPa")):
        text = text.replace(before, after)
    model = parse(text)
    modes = solve_modes(model, 1, cache=False)
    # Bending of the film itself holds the clamped rim flat over ℓ = √(D/T), 0.06 % of the radius
    length = np.sqrt(1e9 * SIZE[0] ** 3 / (12 * (1 - NU**2)) / 100.0)
    k = jn_zeros(0, 1)[0] / (RADIUS - length)
    rigidity = 7e4 * (SIZE[1] ** 3 / 12 + SIZE[1] * HEIGHT[1] ** 2) / (1 - NU**2)

    def density(r: float) -> float:
        radial = -(k**2) * (jv(0, k * r) - jv(1, k * r) / (k * r))
        round_ = -k * jv(1, k * r) / r
        return float(2 * np.pi * r * (radial**2 + round_**2 + 2 * NU * radial * round_))

    bent = rigidity * quad(density, 1e-12, 20e-6)[0]
    zero = jn_zeros(0, 1)[0]
    stretched = 100.0 * np.pi * zero**2 * jv(1, zero) ** 2
    found = solve_quality(modes)
    loss = float(found.lost[1, 0] / found.total[0])
    assert loss == pytest.approx(bent / stretched / 400, rel=2e-3, abs=0)


def test_gas_takes_less_of_a_film_that_layers_weigh_down() -> None:
    modes = solve_modes(laminate(SQUARE, np.array([1e9, 1e8]), metal=QUALITY), 1, cache=False)
    thermal = np.sqrt(8.314462618 * 295 / 0.0280134)
    expected = (np.pi / 2) ** 1.5 * MASS * modes.frequency * thermal / 0.1
    np.testing.assert_allclose(solve_quality(modes, 0.1).gas, expected, rtol=1e-9)


def test_a_layer_without_a_quality_factor_is_named() -> None:
    modes = solve_modes(laminate(SQUARE, np.array([1e9, 1e8])), 1, cache=False)
    with pytest.raises(ParameterError, match=r"\[layers\] 1 metal: Q needs its quality_factor"):
        solve_quality(modes)


@pytest.mark.parametrize("kind", ["square", "hexagonal"])
def test_bands_of_a_covered_film_are_plane_waves_of_its_laminate(kind: Any) -> None:
    """ω² Σρh = Σσh k² + D k⁴ at the folded wave vectors."""
    model = laminate(SQUARE, np.array([1e9, 1e8]))
    lattice = Lattice(kind, 8e-6)
    basis = 2 * np.pi * np.linalg.inv(lattice.steps[:2]).T
    grid = np.stack(np.meshgrid(range(-4, 5), range(-4, 5)), -1).reshape(-1, 2)
    wave = np.array([[0.3, 0.1], [0.5, 0.4]]) * np.pi / 8e-6
    found = solve_bands(model, 5, wave, lattice=lattice)
    assert found.mass == pytest.approx(MASS, rel=1e-10, abs=0)
    np.testing.assert_allclose(found.tension, 108.0 * np.eye(2), rtol=1e-9, atol=1e-9)
    for k, frequency, error in zip(wave, found.frequency, found.frequency_error, strict=True):
        square = np.sum((k + grid @ basis) ** 2, axis=1)
        omega = np.sort(np.sqrt((108.0 * square + RIGIDITY * square**2) / MASS))[:5]
        np.testing.assert_allclose(frequency, omega / (2 * np.pi), rtol=5e-5)
        assert np.all(np.abs(frequency - omega / (2 * np.pi)) <= error)


def test_bands_of_a_pad_that_does_not_repeat_are_refused_by_its_name() -> None:
    model = laminate(
        DISC, np.array([1e9, 1e8]), metal='shape = {kind = "circle", diameter = "9 um"}\n'
    )
    with pytest.raises(ParameterError, match=r"\[layers\] 1 metal: does not repeat with"):
        solve_bands(model, 2, lattice=Lattice("square", 8e-6))
