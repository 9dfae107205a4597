"""Quality factors of a film that causes change, against the film solved anew."""

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from femnl.device.geometry import parse
from femnl.effects import library
from femnl.fits.spectrum.pose import pose
from femnl.io import measurement
from femnl.mechanics.modes.dilution import bending_share
from femnl.mechanics.prestress import solve_units
from femnl.observe.film import UNITS, SimulatedFilm
from femnl.observe.spectrum.model import SpectrumModel
from femnl.pipeline import solve_modes
from tests.physics.test_changed_tension import XX, YY, stressed
from tests.physics.test_tension_gradient import FILM

Array = NDArray[np.float64]
BENT = FILM.replace("bending = false", "bending = true")
SIDES = 'kind = "rectangle"\nwidth = "{:.9f} um"\nheight = "{:.9f} um"'
WIDTH, HEIGHT = 103.0, 97.0
RECTANGLE = BENT.format(outline=SIDES.format(WIDTH, HEIGHT)) + '[readout]\ngap = "10 um"\n'
COUNT = 4
GAP = 10e-6
LOSS = 1e-4
Causes = dict[str, dict[str, float]]


@cache
def film() -> SimulatedFilm:
    return SimulatedFilm(parse(RECTANGLE), 48)


def spectrum() -> SpectrumModel:
    """The lowest modes of the film with any quality factors."""
    known = film()
    modes = known.modes
    group = measurement.spectrum(
        modes.frequency[:COUNT],
        np.full(COUNT, 1.0),
        [str(label) for label in modes.label[:COUNT]],
        None,
        np.full(COUNT, 1e6),
        np.full(COUNT, 1.0),
    )
    return pose(group, known)


def losses(causes: Causes) -> Array:
    """1/Q of the lowest modes under some causes, in parts of the loss angle of bending."""
    model = spectrum()
    own = film()
    base = {"speed": own.speed, "bending_length": own.bending_length, "intrinsic_loss": LOSS}
    effects = [library()[name] for name in causes]
    left = model.residuals(effects, base, list(causes.values()))[COUNT + 1 :]
    return np.asarray(1 / (1e6 - left) / LOSS)


@pytest.mark.slow
def test_other_sides_change_losses_as_the_film_solved_anew_has_them() -> None:
    e = 0.02
    other = BENT.format(outline=SIDES.format(WIDTH * (1 + e / 2), HEIGHT / (1 + e / 2)))
    anew = bending_share(solve_modes(parse(other), COUNT, "auto", 1.0, cache=False))
    plain = bending_share(solve_modes(parse(RECTANGLE), COUNT, "auto", 1.0, cache=False))
    assert np.abs(anew / plain - 1).max() > 0.005  # which is what the changes are measured in
    changed = losses({"aspect_ratio": {"elongation": e}}) / losses({})
    assert changed == pytest.approx(anew / plain, abs=1.2e-3)


def softer(text: str, factor: float) -> str:
    return text.replace('young = "250 GPa"', f'young = "{250 * factor!r} GPa"')


@pytest.mark.slow
def test_another_stress_changes_losses_as_the_film_solved_anew_has_them() -> None:
    a = 0.04
    parts = {XX: a / 2, YY: -a / 2}
    rows = []
    for changes in (parts, {XX: 0.0}):
        squares = []
        for factor in (0.99, 1.01):
            modes = solve_modes(parse(softer(RECTANGLE, factor)), COUNT, "full", 0.8, cache=False)
            units = solve_units(modes.domain, UNITS)
            squares.append(stressed(modes, units, changes)[:COUNT] ** 2)
        rows.append(np.log(squares[1] / squares[0]) / np.log(1.01 / 0.99))
    anew = rows[0] / rows[1]
    assert np.abs(anew - 1).max() > 0.005
    changed = losses({"stress_anisotropy": {"anisotropy": a}}) / losses({})
    assert changed == pytest.approx(anew, abs=1.2e-3)


@pytest.mark.slow
def test_mass_leaves_the_part_of_bending_as_it_is() -> None:
    # Both energies are elastic, and as much smaller at one amplitude as ω² is
    changed = losses({"gas_loading": {"gas_density": 0.5}})
    assert changed == pytest.approx(losses({}), rel=2e-3)


@pytest.mark.slow
def test_a_spring_of_gas_takes_energy_that_does_not_bend() -> None:
    causes = {"trapped_gas": {"pressure": 2e4, "escape_time": 100.0}}
    model = spectrum()
    own = film()
    base = {"speed": own.speed, "bending_length": own.bending_length, "intrinsic_loss": LOSS}
    effects = [library()[name] for name in causes]
    shift = model.residuals([], base, []) - model.residuals(effects, base, list(causes.values()))
    square = (1 + shift[:COUNT] / own.modes.frequency[:COUNT]) ** 2
    assert square[0] > 1.01
    assert losses(causes) == pytest.approx(losses({}) / square, rel=1e-3)
