"""What a frame and a chip do to modes, and the loss of a film of its own."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eig, eigvals

from femnl.core.stages import Lines
from femnl.device.geometry import load
from femnl.effects import library
from femnl.mechanics.modes.dilution import bending_share, dilution
from femnl.observe.film import SimulatedFilm
from femnl.pipeline import solve_modes

FILM = SimulatedFilm(load("square-270um"), 12)
ORDERS = [(1, 1), (2, 1), (1, 2), (2, 2)]


def shares(m: int, n: int) -> tuple[float, float, float]:
    """Squared share of motions 1, x and y in sin·sin of a square, in closed form."""

    def along(order: int) -> tuple[float, float]:
        # ∫ sin² = 1/2; ∫ x sin over x from the middle, whose mean square is 1/12
        even = 2 * (2 / np.pi / order) ** 2 if order % 2 else 0.0
        odd = 24 * (1 / np.pi / order) ** 2 if order % 2 == 0 else 0.0
        return even, odd

    (a, b), (c, d) = along(m), along(n)
    return a * c, b * c, a * d


def test_modes_share_in_rigid_motions_by_their_symmetry() -> None:
    found = FILM.rigid**2 / FILM.modes.effective_mass
    exact = np.array([shares(m, n) for m, n in ORDERS]).T
    # The clamped plate's layer moves 2 % less than the membrane
    np.testing.assert_allclose(found[:, :4], exact, rtol=0.03, atol=1e-9)


def test_the_film_s_own_loss_follows_its_dilution() -> None:
    factor, _ = dilution(FILM.modes)
    np.testing.assert_allclose(FILM.bending_share, 1 / factor, rtol=1e-12)


@pytest.mark.parametrize(
    "factor", [*(pytest.param(f, marks=pytest.mark.slow) for f in (0.5, 0.8)), 1.25, 1.5]
)
def test_the_film_s_own_loss_follows_its_bending_length(factor: float) -> None:
    film = FILM.model.film
    stiffer = replace(FILM.model, film=replace(film, young=film.young * factor**2))
    anew = bending_share(solve_modes(stiffer, FILM.count, cache=False))
    found = FILM.bending_share_at(factor * FILM.bending_length)
    np.testing.assert_allclose(found, anew, rtol=2e-4)
    # High modes gain more than the layer at the edge, so that no common factor says it
    pattern = anew / FILM.bending_share
    assert np.ptp(pattern) / pattern.mean() > 0.02


FREQUENCY = np.array([1.5e6, 2.37e6, 3.35e6])
PARTS = np.array([[0.65, 0.0, 0.07], [0.0, 0.48, 0.0], [0.0, 0.0, 0.0]])


@pytest.mark.parametrize("frame", [1.2e6, 1.496e6, 1.51e6, 3.0e6])
def test_a_frame_pulls_and_damps_each_mode_as_all_of_them_coupled_say(frame: float) -> None:
    heave, tilt, loss = 0.003, 0.004, 2e-3
    push = heave * np.sqrt(PARTS[0]) + tilt * np.sqrt(PARTS[1])
    mass = np.eye(4, dtype=complex)
    mass[3, :3] = mass[:3, 3] = push
    stiffness = np.diag(np.append(FREQUENCY**2 + 0j, frame**2 * (1 + 1j * loss)))
    square, vectors = eig(stiffness, mass)
    film = [int(np.argmax(np.abs(vectors[k]))) for k in range(3)]
    exact = np.sqrt(square[film])
    lines = Lines(FREQUENCY, np.empty(0), np.zeros(3), PARTS)
    found = library()["frame_mode"].changes["frequencies"](
        lines,
        {
            "heave": heave,
            "tilt_x": tilt,
            "tilt_y": 0.0,
            "frame_frequency": frame,
            "frame_loss": loss,
        },
    )
    shift = found.frequency - FREQUENCY
    # Modes also act on each other through the frame, by g² over their distance.
    np.testing.assert_allclose(shift, exact.real - FREQUENCY, rtol=0.02, atol=0.3)
    np.testing.assert_allclose(found.loss, 2 * exact.imag / exact.real, rtol=0.02, atol=1e-9)


def test_a_lossless_frame_at_a_mode_parts_them_by_twice_the_coupling() -> None:
    lines = Lines(np.array([1e6 - 1e-3, 1e6 + 1e-3]), np.empty(0), np.empty(0), np.ones((3, 2)))
    values = {"heave": 4e-5, "tilt_x": 0.0, "tilt_y": 0.0}
    found = library()["frame_mode"].changes["frequencies"](
        lines, values | {"frame_frequency": 1e6, "frame_loss": 1e-10}
    )
    pair = np.sqrt(np.sort(eigvals(np.diag([1e12, 1e12]), [[1, 4e-5], [4e-5, 1]]).real))
    np.testing.assert_allclose(found.frequency, pair, atol=2e-3)


def test_the_chip_takes_from_a_square_what_wilson_rae_found() -> None:
    # PRL 106, 047205: 1/Q ∝ (m² + n²)^{3/2}/(m²n²) of modes odd along both sides.
    m, n = np.array([(1, 1), (1, 3), (3, 3), (1, 5)]).T
    heave = np.array([shares(*order)[0] for order in zip(m, n, strict=True)])
    f = np.hypot(m, n) * 1e6
    lines = Lines(f, np.empty(0), np.zeros(4), np.stack([heave, 0 * heave, 0 * heave]))
    found = library()["clamp_loss"].changes["frequencies"](lines, {"monopole": 1e-6, "dipole": 0.2})
    published = (m**2 + n**2) ** 1.5 / (m**2 * n**2)
    np.testing.assert_allclose(found.loss / found.loss[0], published / published[0], rtol=1e-12)
