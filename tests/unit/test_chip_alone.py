"""Devices that deviate from their chip, diagnosed with the chip as prior knowledge."""

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.optimize import brentq, linear_sum_assignment

from femnl.chip import ChipFit, fit_chip, read_chip
from femnl.chip.result import Cause

SEED = 20261125
MODES = ((1, 1), (1, 2), (2, 1), (2, 2), (1, 3), (3, 1))
SIDE = 270e-6
SPEED = 596.0
WRONG = 0.004
"""What all devices of the chip have of mode (2,2), and the simulation has not, relative."""
Array = NDArray[np.float64]


def particle(part: float, x: float, y: float) -> Array:
    """F over that of the plain film, of K = k², M = 1 + 4 (Δm/M) φφᵀ on 400 sines.

    x, y in sides from a corner. Modes go by the sine that they have most of.
    """
    m, n = (1 + np.indices((20, 20))).reshape(2, -1)
    shape = np.sin(np.pi * m * x) * np.sin(np.pi * n * y)
    square = m**2 + n**2
    found, vectors = eigh(np.diag(square), np.eye(400) + 4 * part * np.outer(shape, shape))
    lowest = vectors[:, : len(MODES)] ** 2
    rows = [int(np.flatnonzero((m == a) & (n == b))[0]) for a, b in MODES]
    _, column = linear_sum_assignment(-lowest[rows])
    return np.asarray(np.sqrt(found[column] / square[rows]))


def stretched(anisotropy: float) -> Array:
    """ω² ∝ (1 + a/2) m² + (1 − a/2) n²."""
    m2, n2 = np.array(MODES).T ** 2
    return np.asarray(np.sqrt(1 + anisotropy / 2 * (m2 - n2) / (m2 + n2)))


def reaching(depth: float) -> Array:
    """F over that of the plain film, of kL + 2 atan kδ = mπ in both directions."""

    def wavenumber(order: int) -> float:
        def miss(k: float) -> float:
            return float(k * SIDE + 2 * np.arctan(k * depth) - order * np.pi)

        return float(brentq(miss, 0, order * np.pi / SIDE))

    plain = np.hypot(*np.array(MODES).T) * np.pi / SIDE
    found = np.array([np.hypot(wavenumber(m), wavenumber(n)) for m, n in MODES])
    return np.asarray(found / plain)


def chip(folder: Path, odd: Array) -> ChipFit:
    """Twelve squares alike to 3e-4, and one beside them."""
    rng = np.random.default_rng(SEED)
    lines = ['name = "one odd device"', '[design.square]\ngeometry = "square-270um"']
    for k in range(13):
        shift = np.exp(rng.normal(0, 3e-4) + rng.normal(0, 2e-5, len(MODES)))
        factor = odd if k == 5 else np.ones(len(MODES))
        modes = []
        for (m, n), f in zip(MODES, shift * factor, strict=True):
            frequency = f * SPEED * np.hypot(m, n) / (2 * SIDE) * (1 + WRONG * ((m, n) == (2, 2)))
            modes.append(f'{{mode = "{m},{n}", frequency = {frequency:.1f}, frequency_sd = 3.0}}')
        lines.append(f'[[device]]\nname = "D{k}"\ndesign = "square"\nmodes = [{", ".join(modes)}]')
    path = folder / "study.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    return fit_chip(read_chip(path))


def only(fit: ChipFit) -> Cause:
    (cause,) = fit.causes
    assert cause.device == "D5"
    return cause


@pytest.mark.slow
def test_a_particle_is_told_from_the_modes_of_one_device(tmp_path: Path) -> None:
    cause = only(chip(tmp_path, particle(0.01, 0.37, 0.41)))
    assert cause.name == "added_mass"
    mass = re.search(r"mass ([0-9.]+) ± [0-9.]+ pg", cause.words)
    assert mass is not None
    # 1 % of ρhL² = 41.5 ng
    assert float(mass[1]) == pytest.approx(415, rel=0.03)


@pytest.mark.slow
def test_unequal_stress_is_told_or_its_equal(tmp_path: Path) -> None:
    cause = only(chip(tmp_path, stretched(0.01)))
    assert cause.name in ("stress_anisotropy", "aspect_ratio")
    assert "may do the same" in cause.words


def test_a_clamp_that_yields_is_seen_by_what_it_does_to_all_modes_alike(tmp_path: Path) -> None:
    cause = only(chip(tmp_path, reaching(4e-6)))
    assert cause.name == "compliant_clamp"


@pytest.mark.parametrize(
    ("factor", "words"),
    [pytest.param(1.01, "no cause of", marks=pytest.mark.slow), (0.985, "another stress")],
)
@pytest.mark.slow
def test_another_stress_of_one_device_is_no_cause_of_the_library(
    factor: float, words: str, tmp_path: Path
) -> None:
    """Nor where a cause lowers all modes nearly alike, as a clamp that yields."""
    cause = only(chip(tmp_path, np.full(len(MODES), factor)))
    assert cause.name == "other film or shape"
    assert words in cause.words


@pytest.mark.slow
def test_a_mass_that_loads_all_modes_alike_is_seen_by_the_speed_of_the_chip(
    tmp_path: Path,
) -> None:
    # In the middle of a quarter, where most of the six modes have the same shift
    cause = only(chip(tmp_path, particle(0.004, 0.27, 0.25)))
    assert cause.name == "added_mass"
