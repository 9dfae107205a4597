"""Spectra of films that differ from their geometry: thinner, sheared, cleaner."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh

from femnl.core.diagnosis import Diagnosis
from femnl.core.errors import MeasurementError
from femnl.device.geometry import load
from femnl.diagnose import diagnose
from femnl.fits.spectrum.labels import named_modes
from femnl.fits.spectrum.pose import BENDING_SD
from femnl.io import measurement
from femnl.observe.film import SimulatedFilm
from femnl.pipeline import solve_modes

Array = NDArray[np.float64]
SQUARE = "square-270um"
MODES = 14
NOISE = 5.0


def measured(
    path: Path, frequency: Array, label: list[str] | None, geometry: str = SQUARE
) -> Diagnosis:
    noise = NOISE * np.random.default_rng(24).standard_normal(len(frequency))
    data = measurement.spectrum(frequency + noise, np.full(len(frequency), NOISE), label)
    file = path / "a.nc"
    measurement.write(measurement.bundle({"spectrum": data}, geometry=geometry), file)
    return diagnose(file)


def thinner(thickness: float) -> tuple[Array, list[str]]:
    """Return frequencies [Hz] and labels of the square film, solved at another thickness [m]."""
    model = load(SQUARE)
    modes = solve_modes(replace(model, film=replace(model.film, thickness=thickness)), MODES)
    return modes.frequency, [str(name).strip("()") for name in modes.label]


def bending_square(thickness: float) -> float:
    """Return ℓ² [m²] of a plate."""
    film = load(SQUARE).film
    return thickness**2 * film.young / (12 * (1 - film.poisson**2) * film.stress)


@pytest.mark.slow
def test_a_film_a_fifth_thinner_is_within_what_is_known_of_films(tmp_path: Path) -> None:
    found = measured(tmp_path, *thinner(150e-9))
    assert found.verdict == "adequate"
    length = found.parameters["base"]["bending_length"]
    assert abs(length.value - np.sqrt(bending_square(150e-9))) < 4 * length.sd


@pytest.mark.slow
def test_a_film_that_lost_half_its_thickness_is_told_as_less_stiff(tmp_path: Path) -> None:
    thickness = 92e-9
    found = measured(tmp_path, *thinner(thickness))
    assert (found.verdict, found.causes) == ("explained", ("bending_stiffness",))
    excess = found.parameters["bending_stiffness"]["excess"]
    truth = bending_square(thickness) - bending_square(load(SQUARE).film.thickness)
    # ℓ of the geometry and its change share what is known of either.
    sd = np.hypot(excess.sd, 2 * BENDING_SD * bending_square(load(SQUARE).film.thickness))
    assert abs(excess.value - truth) < 3 * sd


@pytest.mark.slow
def test_a_film_without_holes_has_no_lattice_of_holes(tmp_path: Path) -> None:
    found = measured(tmp_path, *thinner(92e-9))
    told = [found.causes, *(rival.causes for rival in found.alternatives)]
    assert not any("hole_dispersion" in causes for causes in told)


def sheared(shear: float, count: int) -> tuple[Array, Array, list[tuple[int, int]]]:
    """Return f/f₁₁ and vectors of a square membrane under T(I + shear (xy + yx)), by sines.

    ∂ₓ∂ᵧ couples sin mx sin ny to sin px sin qy where m + p and n + q are odd.
    """
    orders = [(m, n) for m in range(1, count + 1) for n in range(1, count + 1)]
    stiffness = np.zeros((len(orders), len(orders)))
    for i, (m, n) in enumerate(orders):
        for j, (p, q) in enumerate(orders):
            if i == j:
                stiffness[i, j] = (m * m + n * n) / 2
            elif (m + p) % 2 and (n + q) % 2:
                along_x = 4 * m / (np.pi * (m * m - p * p))
                along_y = 4 * n / (np.pi * (n * n - q * q))
                stiffness[i, j] = -2 * shear * p * q * along_x * along_y / 2
    square, vectors = eigh((stiffness + stiffness.T) / 2)
    return np.sqrt(square), vectors, orders


@pytest.mark.slow
def test_pairs_that_shear_mixes_go_by_their_own_names(tmp_path: Path) -> None:
    model = load(SQUARE)
    modes = solve_modes(model, MODES)
    names = [str(name).strip("()") for name in modes.label]
    ratio, vectors, orders = sheared(2e-3, 18)
    plain, _, _ = sheared(0.0, 18)
    # Of two that shear parts, the named ones are those in which sines have equal shares.
    low = {}
    for k in range(MODES):
        first, second = np.argsort(-np.abs(vectors[:, k]))[:2]
        (m, n), (p, q) = sorted((orders[first], orders[second]))
        pair = abs(vectors[second, k]) > 0.5
        sign = "+" if vectors[first, k] * vectors[second, k] > 0 else "-"
        low[f"({m},{n}){sign}({p},{q})" if pair else "{},{}".format(*orders[first])] = k
    shift = ratio / plain
    assert {"(1,2)+(2,1)", "(1,2)-(2,1)", "(2,3)-(3,2)"} <= low.keys()
    frequency = np.sort(modes.frequency)[list(low.values())] * shift[list(low.values())]
    assert len(names) == MODES
    found = measured(tmp_path, frequency, list(low))
    assert (found.verdict, found.causes) == ("explained", ("shear_stress",))
    shear = found.parameters["shear_stress"]["shear"]
    assert abs(shear.value - 2e-3) < 4 * shear.sd


@pytest.mark.parametrize(
    ("label", "message"),
    [
        (("1,1", "1,2", "(1,2)*(2,1)"), r"'\(1,2\)\*\(2,1\)' is no mode; write it as"),
        (("1,1", "1,1", "2,1"), "'1,1' names a mode that another label names too"),
        (("1,1", "(1,90)+(90,1)", "2,1"), "is none of the first 48 modes of square-270um"),
        (("(1,3)+(3,1)", "1,1", "(3,1)+(1,3)"), "names a mode that another label names too"),
    ],
)
def test_labels_that_name_no_mode_are_refused_by_name(label: tuple[str, ...], message: str) -> None:
    with pytest.raises(MeasurementError, match=message):
        named_modes(label, SimulatedFilm(load(SQUARE), 48))


def test_a_pair_holds_both_modes_evenly_and_each_label_has_a_mode_of_its_own() -> None:
    film = SimulatedFilm(load(SQUARE), 48)
    named = named_modes(("(1,3)+(3,1)", "1,1", "(1,3)−(3,1)"), film)
    assert sorted(named.order) == [0, 4, 5]
    np.testing.assert_allclose(named.target @ named.target.T, np.eye(3), atol=1e-12)


@pytest.mark.slow
def test_residue_that_the_film_lost_is_found_as_mass_below_zero(tmp_path: Path) -> None:
    model = load(SQUARE)
    modes = solve_modes(model, MODES)
    film = SimulatedFilm(model, 48)
    place = (0.31 * 135e-6, -0.17 * 135e-6)
    whole = film.modes
    shape = film.projection.at(*(np.array([c]) for c in place))[:, 0]
    lost = -2e-3 * whole.effective_mass[0]
    # Rayleigh's quotient over all modes, whose own masses the shapes are scaled to
    unit = shape / np.sqrt(whole.effective_mass)
    square = eigh(
        np.diag(whole.frequency**2), np.eye(48) + lost * np.outer(unit, unit), eigvals_only=True
    )
    found = measured(tmp_path, np.sqrt(square)[: len(modes.frequency)], None)
    assert found.causes == ("added_mass",)
    mass = found.parameters["added_mass"]["mass"]
    assert mass.value < 0
    assert abs(mass.value / lost - 1) < 0.15
