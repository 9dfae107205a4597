"""Films with an electrode as a diagnosis changes them, against the same films solved anew."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh

from femnl import load
from femnl.cli._fit_spectrum import film as fit_spectrum
from femnl.core.device import Model
from femnl.core.diagnosis import Diagnosis
from femnl.core.errors import ParameterError
from femnl.core.stages import ModalSystem
from femnl.core.tension import YIELDS_MOST, strengths
from femnl.device.geometry import parse
from femnl.diagnose import diagnose
from femnl.effects import library
from femnl.io import measurement
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import Assembly, as_matrix, cells, local_matrices, slope
from femnl.mechanics.fem.sheet import Sheet
from femnl.mechanics.fem.solvers import lowest_eigenpairs
from femnl.mechanics.modes.operators import Operators
from femnl.observe.film import SimulatedFilm
from femnl.pipeline import solve_modes
from tests.blind.lab.electrode import frequencies as laboratory
from tests.physics.changed_films import system_of

Array = NDArray[np.float64]
COUNT = 40
LOWEST = 12

GEOMETRY = """
name = "electrode"
[outline]
{outline}
[film]
thickness = "100 nm"
young = "250 GPa"
poisson = 0.23
density = "3000 kg/m^3"
stress = "400 MPa"
[[layers]]
name = "metal"
thickness = "60 nm"
young = "70 GPa"
poisson = 0.34
density = "2700 kg/m^3"
stress = "150 MPa"
shape = {shape}
"""
DRUM = 'kind = "circle"\ndiameter = "100 um"'
SQUARE = 'kind = "square"\nside = "100 um"'
ROUND = '{kind = "circle", diameter = "50 um"}'


def electrode(outline: str = SQUARE, shape: str = ROUND, more: str = "") -> Model:
    return parse(GEOMETRY.format(outline=outline, shape=shape) + more)


@cache
def film() -> SimulatedFilm:
    return SimulatedFilm.for_spectra(electrode(), COUNT)


def lowest(system: ModalSystem, effect: str = "", values: Mapping[str, float] = {}) -> Array:
    """Return the frequencies [Hz] of the lowest modes, under one cause or none."""
    if effect:
        system = library()[effect].changes["operators"](system, values)
    square = eigh(system.stiffness, system.mass, eigvals_only=True)
    return np.asarray(np.sqrt(square[:LOWEST]) / (2 * np.pi))


def anew(model: Model) -> Array:
    return solve_modes(model, LOWEST, cache=False).frequency


def test_a_film_that_layers_cover_evenly_is_the_one_of_one_material() -> None:
    """Its integrals are those of its own film alone, h of which is less: c and σ are its own."""
    model = electrode(shape='{kind = "square", side = "100 um"}')
    even = replace(model, layers=tuple(replace(one, rims=()) for one in model.layers))
    text = "\n".join(line for line in model.text.splitlines() if not line.startswith("shape"))
    alike = SimulatedFilm.of_one_material(parse(text), 16)
    layered = SimulatedFilm(even, 16, layered=True)
    own = layered.model.film
    other = alike.model.film
    assert layered.modes.frequency == pytest.approx(alike.modes.frequency, rel=2e-5)
    share = own.thickness / other.thickness
    first, second = (one.projection for one in (layered, alike))
    np.testing.assert_allclose(abs(first.slopes), share * abs(second.slopes), rtol=1e-3, atol=1e-9)
    np.testing.assert_allclose(abs(first.masses), abs(second.masses), rtol=1e-3, atol=1e-18)
    np.testing.assert_allclose(abs(layered.rigid), abs(alike.rigid), rtol=1e-3, atol=1e-10)
    np.testing.assert_allclose(
        layered.area, alike.modes.effective_mass / (other.density * other.thickness), rtol=5e-5
    )
    np.testing.assert_allclose(layered.bending_share, alike.bending_share, rtol=1e-3)
    ratio = own.stress * own.thickness / (other.stress * other.thickness)
    for name in ("deviator", "shear", "bowl"):
        assert first.tension is not None
        assert second.tension is not None
        found = own.stress * first.tension(strengths({name: 0.04}))
        expected = other.stress * second.tension(strengths({name: 0.04 * ratio}))
        values = np.linalg.eigvalsh(found[:8, :8])
        exact = np.linalg.eigvalsh(expected[:8, :8])
        np.testing.assert_allclose(values, exact, rtol=1e-3, atol=1e-4 * abs(exact).max())


@pytest.mark.parametrize(
    "factor",
    [
        pytest.param(0.0, marks=pytest.mark.slow),
        pytest.param(0.6, marks=pytest.mark.slow),
        pytest.param(1.0, marks=pytest.mark.slow),
        1.5,
        pytest.param(3.0, marks=pytest.mark.slow),
    ],
)
@pytest.mark.slow
def test_frequencies_follow_c_and_the_bending_length_as_the_film_does(factor: float) -> None:
    """All densities and all moduli change by one factor each."""
    model = electrode()
    stiffer = replace(model, bending=factor > 0)
    layers = tuple(replace(one, density=2 * one.density) for one in model.layers)
    own = replace(stiffer.film, density=2 * stiffer.film.density)
    if factor > 0:
        layers = tuple(replace(one, young=factor**2 * one.young) for one in layers)
        own = replace(own, young=factor**2 * own.young)
    exact = anew(replace(stiffer, film=own, layers=layers))
    known = film()
    found = known.frequency(known.speed / np.sqrt(2), factor * known.bending_length)
    # From 2.5 to 4 times ℓ no film was solved
    near = 2e-6 if factor < 2 else 5e-5
    assert found[:LOWEST] == pytest.approx(exact, rel=near)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("stress_anisotropy", {"anisotropy": 0.15}),
        ("shear_stress", {"shear": -0.08}),
    ],
)
def test_unequal_stress_of_the_film_does_what_it_does_to_the_film_anew(
    name: str, values: dict[str, float]
) -> None:
    """Even stress of an even film pulls on nothing: N gains h σ s everywhere, also under metal."""
    modes = solve_modes(electrode(), LOWEST, "full", cache=False)
    domain = modes.domain
    own = domain.model.film
    pull = own.thickness * own.stress
    half = values.get("anisotropy", 0.0) / 2
    field = pull * np.array([half, -half, values.get("shear", 0.0)])
    operators = Operators(modes.prestress, modes.degree)
    space = Space(domain.mesh, modes.degree)
    more = Assembly(space.size)
    for cell in cells(space, 2 * modes.degree):
        local = local_matrices(slope(cell.jet), as_matrix(field), cell.dx)
        more.add(local, space.dofs[cell.triangles])
    free = operators.free(())
    stiffness = (operators.stiffness(()) + more.matrix()).tocsc()[free][:, free]
    square, _ = lowest_eigenpairs(stiffness, operators.mass[free][:, free], LOWEST + 4)
    exact = np.sqrt(square[:LOWEST]) / (2 * np.pi)
    assert lowest(system_of(film()), name, values) == pytest.approx(exact, rel=2e-6)


@pytest.mark.slow
def test_an_edge_that_yields_does_what_springs_do_to_the_film_anew() -> None:
    model = electrode()
    compliance = 0.3 * YIELDS_MOST * 50e-6
    across = model.film.young * model.film.thickness / compliance
    along = across * (1 - model.film.poisson) / 2
    more = f'[clamp]\nnormal = "{across:.15g} Pa"\nshear = "{along:.15g} Pa"\n'
    found = lowest(system_of(film()), "yielding_edge", {"compliance": compliance})
    assert found == pytest.approx(anew(electrode(more=more)), rel=2e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    "excess",
    [
        -0.3,
        0.07,
        0.27,
        0.46,
    ],
)
def test_thicker_layers_do_what_they_do_to_the_film_anew(excess: float) -> None:
    model = electrode()
    thick = model.with_("layers.1.thickness", f"{60 * (1 + excess)} nm")
    system = replace(system_of(film()), thicker=film().thicker)
    found = lowest(system, "layer_thickness", {"excess": excess})
    assert found == pytest.approx(anew(thick), rel=2e-6)


def test_what_is_left_of_a_bowl_of_stress_is_that_of_a_disc_in_a_disc() -> None:
    """Of u″ + u′/r − u/r² = −t′/A, t = hσr²/R², on either side of the rim of the electrode.

    u = αr − cr³/4A₁ within, βr + γ/r − cr³/4A₂ without, c = hσ/R²; u and N go on across the rim.
    """
    known = SimulatedFilm.for_spectra(electrode(DRUM), 12)
    own = known.model.film
    layer = known.model.layers[0]
    edge = 50e-6
    rim = 25e-6
    bare = own.thickness * own.young / (1 - own.poisson**2)
    metal = layer.thickness * layer.young / (1 - layer.poisson**2)
    stiff = np.array([bare + metal, bare])
    across = np.array([own.poisson * bare + layer.poisson * metal, own.poisson * bare])
    c = own.thickness * own.stress / edge**2
    cubic = -c / (4 * stiff)
    # N = A₁₁u′ + A₁₂u/r + cr² of r, 1/r and r³
    line = stiff + across
    inverse = across - stiff
    third = (3 * stiff + across) * cubic + c
    known_side = [
        [rim, -rim, -1 / rim],
        [0, edge, 1 / edge],
        [line[0], -line[1], -inverse[1] / rim**2],
    ]
    other_side = [
        (cubic[1] - cubic[0]) * rim**3,
        -cubic[1] * edge**3,
        (third[1] - third[0]) * rim**2,
    ]
    alpha, beta, gamma = np.linalg.solve(known_side, other_side)
    r = np.linspace(0, edge, 20001)[1:]
    within = alpha * line[0] + third[0] * r**2
    without = beta * line[1] + gamma * inverse[1] / r**2 + third[1] * r**2
    pull = np.where(r < rim, within, without)
    slope_of_mode = np.gradient(known.projection.at(r, 0 * r)[0], r)
    exact = 2 * np.pi * np.trapezoid(pull * slope_of_mode**2 * r, r)
    parts = [known.projection.slopes[w, d, 0, 0] for w in (3, 5) for d in (0, 1)]
    assert own.stress * sum(parts) == pytest.approx(exact, rel=1e-3)


def test_rigid_motions_and_areas_are_integrals_over_film_and_electrode() -> None:
    known = film()
    modes = known.modes
    space = Space(modes.domain.mesh, modes.degree)
    sheet = Sheet(modes.domain)
    total = np.zeros(2)
    heave = 0.0
    area = np.zeros(COUNT)
    for cell in cells(space, 2 * modes.degree):
        mass = sheet.inertia(cell.triangles, cell.jet.point) * cell.dx
        shape = np.einsum(
            "eqj,nej->neq", cell.jet.value, modes.shapes[:, space.dofs[cell.triangles]]
        )
        total += [np.sum(mass), np.sum(mass * shape[0])]
        area += np.sum(cell.dx * shape**2, axis=(1, 2))
    copies = modes.domain.copies
    heave = copies * total[1] / np.sqrt(copies * total[0])
    assert abs(known.rigid[0, 0]) == pytest.approx(abs(heave), rel=1e-3)
    assert known.area == pytest.approx(copies * area, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("gap", [np.inf, 1e-6])
def test_gas_moves_with_the_film_however_much_metal_lies_on_it(gap: float) -> None:
    """Metal as heavy as nothing leaves the gas of the bare film; its area is that of the modes."""
    bare = SimulatedFilm(replace(electrode(), layers=()), 12)
    light = replace(electrode().layers[0], density=1e-3, stress=0.0, young=1.0)
    layered = SimulatedFilm(replace(electrode(), layers=(light,)), 12, layered=True)
    gas = {"gas_density": 1.2}
    found = []
    for one in (bare, layered):
        system = replace(system_of(one), gap=gap, airload=one.airload, area=one.area)
        found.append(np.diag(library()["gas_loading"].changes["operators"](system, gas).mass))
    assert found[1] == pytest.approx(found[0], rel=1e-5)


SHIPPED = "metallised-drum"


def diagnosed(frequency: Array, folder: Path) -> Diagnosis:
    """Diagnose frequencies with noise of 1e-5, as those of the shipped drum."""
    sd = 1e-5 * frequency
    noise = np.random.default_rng(27).normal(0, sd)
    group = measurement.spectrum(frequency + noise, sd)
    path = folder / "drum.nc"
    measurement.write(measurement.bundle({"spectrum": group}), path)
    return diagnose(path, geometry=SHIPPED)


@pytest.mark.slow
def test_a_metallised_drum_without_a_cause_is_adequate_and_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    found = diagnosed(laboratory(load(SHIPPED), 14), tmp_path)
    assert found.verdict == "adequate"
    # Said once, by a note, and not for each variant that is solved
    assert sum("at rest is bent by about" in note for note in found.notes) == 1
    assert "bend the film at rest" not in caplog.text
    assert any("layers lie on the film as its geometry says" in note for note in found.notes)
    assert any("left out" in note and "aspect_ratio" in note for note in found.notes)


@pytest.mark.parametrize("thicker", [0.0, 0.3])
def test_the_laboratory_has_the_frequencies_of_the_drum(thicker: float) -> None:
    model = load(SHIPPED)
    thick = model.with_("layers.1.thickness", f"{30 * (1 + thicker)} nm")
    modes = solve_modes(thick, 14, cache=False)
    made = laboratory(model, 14, thicker)
    assert np.all(np.abs(made - modes.frequency) < modes.frequency_error)
    assert made == pytest.approx(modes.frequency, rel=2e-6)


@pytest.mark.slow
@pytest.mark.parametrize("thicker", [0.2, -0.06])
def test_an_electrode_of_another_thickness_is_named(thicker: float, tmp_path: Path) -> None:
    found = diagnosed(laboratory(load(SHIPPED), 14, thicker), tmp_path)
    assert found.causes == ("layer_thickness",)
    told = found.parameters["layer_thickness"]["excess"]
    assert abs(told.value - thicker) < 4 * told.sd
    assert told.sd < 0.01


@pytest.mark.slow
def test_an_edge_of_a_metallised_drum_that_yields_is_named(tmp_path: Path) -> None:
    compliance = 0.03 * 135e-6
    film = load(SHIPPED).film
    across = film.young * film.thickness / compliance
    along = across * (1 - film.poisson) / 2
    springs = f'[clamp]\nnormal = "{across:.12g} Pa"\nshear = "{along:.12g} Pa"\n'
    true = parse(load(SHIPPED).text + springs)
    found = diagnosed(solve_modes(true, 14, cache=False).frequency, tmp_path)
    assert found.causes == ("yielding_edge",)
    told = found.parameters["yielding_edge"]["compliance"]
    assert abs(told.value - compliance) < 4 * told.sd


GRAIN = """
[[layers]]
name = "grain"
thickness = "400 nm"
young = "1 MPa"
poisson = 0.2
density = "3000 kg/m^3"
stress = "0 Pa"
[layers.shape]
kind = "combined"
parts = [{shape = {kind = "circle", diameter = "5 um"}, at = ["40 um", "25 um"]}]
"""


@pytest.mark.slow
def test_a_grain_on_the_electrode_of_a_drum_is_named_with_its_mass_and_place(
    tmp_path: Path,
) -> None:
    """Solved as a soft heavy disc on top of the metal, where its mesh follows it."""
    true = parse(load(SHIPPED).text + GRAIN)
    found = diagnosed(solve_modes(true, 14, cache=False).frequency, tmp_path)
    assert found.causes == ("added_mass",)
    told = found.parameters["added_mass"]
    mass = 400e-9 * 3000 * np.pi * 2.5e-6**2
    assert told["mass"].value == pytest.approx(mass, rel=0.03)
    away = np.hypot(told["x"].value, told["y"].value)
    assert away == pytest.approx(np.hypot(40e-6, 25e-6), rel=0.02)


@pytest.mark.slow
def test_a_fit_of_a_spectrum_gives_the_film_below_its_layers() -> None:
    modes = solve_modes(electrode(), 8, cache=False)
    group = measurement.spectrum(1.01 * modes.frequency, 1e-5 * modes.frequency)
    (outcome,) = fit_spectrum("spectrum", group, electrode(), False, {}).values()
    speed = outcome.record["parameters"]["wave_speed"]["value"]
    assert speed == pytest.approx(1.01 * film().speed, rel=1e-5)
    assert any("layers lie on the film" in note for note in outcome.record["notes"])


def test_layers_that_end_at_free_edges_are_refused() -> None:
    holes = '[[holes]]\nlattice = "list"\ncentres = [["0 um", "0 um"]]\nradius = "5 um"\n'
    with pytest.raises(ParameterError, match=r"bend the film at rest from its free"):
        SimulatedFilm.for_spectra(electrode(more=holes), 4)
