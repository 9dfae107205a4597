"""A film of one material in the place of layers: it moves as they do, and says which it is."""

from pathlib import Path

import numpy as np
import pytest

from femnl.core.device import Model
from femnl.core.errors import ParameterError
from femnl.device.geometry import parse
from femnl.diagnose import diagnose
from femnl.io import measurement
from femnl.mechanics.fem.laminate import one_material
from femnl.pipeline import solve_modes, solve_nonlinearity
from tests.physics.layered_text import FILM

SQUARE = '[outline]\nkind = "square"\nside = "100 um"\n'
DISC = '[outline]\nkind = "circle"\ndiameter = "100 um"\n'


def layer(poisson: float = 0.23, more: str = "", thickness: str = "60 nm") -> str:
    return (
        f'[[layers]]\nname = "metal"\nthickness = "{thickness}"\nyoung = "70 GPa"\n'
        f'poisson = {poisson}\ndensity = "2700 kg/m^3"\nstress = "-20 MPa"\n{more}'
    )


def device(outline: str, layers: str, stress: str = "1 GPa", head: str = "") -> Model:
    return parse(f'name = "layered"\n{head}{outline}{FILM.format(stress=stress)}{layers}')


@pytest.mark.parametrize("outline", [SQUARE, pytest.param(DISC, marks=pytest.mark.slow)])
@pytest.mark.parametrize("stress", ["1 GPa", "20 MPa"])
@pytest.mark.parametrize("poisson", [0.23, 0.42])
def test_one_material_has_the_frequencies_and_masses_of_the_layers(
    outline: str, stress: str, poisson: float
) -> None:
    """Also with unlike Poisson's ratios, as a plate held all around knows of its rigidity alone."""
    bottom = 'side = "bottom"\n'
    layers = layer(poisson) + layer(0.3 if poisson > 0.3 else poisson, bottom, "25 nm")
    layered = device(outline, layers, stress)
    alike = one_material(layered)
    assert not alike.layers
    own, other = (solve_modes(model, 4, cache=False) for model in (layered, alike))
    away = np.abs(other.frequency - own.frequency)
    assert np.all(away <= own.frequency_error + other.frequency_error)
    assert np.all(away <= 2e-5 * own.frequency)
    np.testing.assert_allclose(other.effective_mass, own.effective_mass, rtol=2e-5)


def test_one_material_stretches_as_the_layers_do() -> None:
    layered = device(SQUARE, layer())
    duffing = [
        solve_nonlinearity(solve_modes(model, 3, cache=False), cache=False)
        for model in (layered, one_material(layered))
    ]
    np.testing.assert_allclose(duffing[1].k3, duffing[0].k3, rtol=2e-5)


def test_a_film_without_layers_is_its_own() -> None:
    model = device(SQUARE, "")
    assert one_material(model) is model


def test_what_is_assumed_of_a_layer_is_assumed_of_the_film() -> None:
    assumed = 'assumed = ["layers.1.thickness"]\n'
    assert one_material(device(SQUARE, layer(), head=assumed)).assumed == ("film",)


FREE = '[[holes]]\nlattice = "list"\ncentres = [["0 um", "0 um"]]\nradius = "5 um"\n'
SHAPE = 'shape = {kind = "circle", diameter = "40 um"}\n'


@pytest.mark.parametrize(
    ("outline", "more", "told"),
    [
        (SQUARE, SHAPE, r"\[layers\] 1 metal: .* cover the whole film only"),
        (SQUARE + FREE, "", r"\[layers\]: their stresses bend the film at rest from its free"),
    ],
)
def test_layers_that_no_film_of_one_material_stands_for_are_named(
    outline: str, more: str, told: str
) -> None:
    with pytest.raises(ParameterError, match=told):
        one_material(device(outline, layer(more=more)))


@pytest.mark.slow
def test_the_cause_of_a_layered_films_spectrum_is_named(tmp_path: Path) -> None:
    """A rectangle in the place of a square, with its layer: solved with layers, by other meshes."""
    side = 'width = "100.6 um"\nheight = "99.4 um"\n'
    true = device(f'[outline]\nkind = "rectangle"\n{side}', layer())
    modes = solve_modes(true, 12, cache=False)
    sd = 2e-5 * modes.frequency
    noise = np.random.default_rng(27).normal(0, sd)
    group = measurement.spectrum(modes.frequency + noise, sd, [str(label) for label in modes.label])
    path = tmp_path / "layered.nc"
    measurement.write(measurement.bundle({"spectrum": group}), path)
    geometry = tmp_path / "layered.toml"
    geometry.write_text(device(SQUARE, layer()).text, encoding="utf-8")
    found = diagnose(path, geometry=str(geometry))
    assert found.causes == ("aspect_ratio",)
    assert any("film and layers are taken for one film" in note for note in found.notes)
