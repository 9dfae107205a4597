"""Rings in the maps of a strongly driven membrane: motion or readout?

Rings were once read as overtones of the motion, localised in space (arXiv:1902.01270), and later as
the fringe that the motion sweeps (arXiv:2502.19191). Harmonics of the readout follow from one
amplitude, in an order and with phases that the fringe sets; harmonics of the motion have the shape
of a mode and are the same in metres at every wavelength. Both worlds are simulated in time, and
diagnosed.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import femnl
from femnl.diagnose import diagnose
from femnl.io import measurement

# Wavelength [m], phase of the fringe at rest [rad]
LASERS = {"red": (632.8e-9, 0.6), "green": (532e-9, 1.1)}
# V
CONTRAST = 20e-3
NOISE = 2e-4
TIMES = 2 * np.pi * np.arange(128) / 128
POINTS = 25
SEED = 5


@dataclass(frozen=True)
class World:
    """Return the motion [m] of the fundamental mode and of those near 2 and 3 times it."""

    fundamental: float
    overtones: tuple[float, float]
    harmonics: tuple[int, ...] = (1, 2, 3, 4, 5, 6)


READOUT = World(446e-9, (0.0, 0.0))
MOTION = World(25e-9, (12e-9, 8e-9))
# The second harmonic alone, and hardly more than the noise
FAINT = World(25e-9, (0.48e-9, 0.0), (2,))


def simulate(world: World, lasers: tuple[str, ...], path: Path) -> Path:
    """Write the maps of a world.

    The motion in time at every point, the fringe, and a Fourier transform, with noise.
    """
    rng = np.random.default_rng(SEED)
    modes = femnl.solve_modes(femnl.load("square-270um"), 12)
    axis = np.linspace(-135e-6, 135e-6, POINTS)
    x, y = np.meshgrid(axis, axis)
    motion = (
        world.fundamental
        * np.cos(TIMES)[:, None, None]
        * femnl.mechanics.modes.shape_at(modes, 0, x, y)
    )
    for n, size in enumerate(world.overtones, start=2):
        near = int(np.argmin(np.abs(modes.frequency - n * modes.frequency[0])))
        motion = motion + size * np.cos(n * TIMES)[:, None, None] * femnl.mechanics.modes.shape_at(
            modes, near, x, y
        )
    groups = {}
    for laser in lasers:
        wavelength, theta = LASERS[laser]
        found = (
            2
            * np.fft.fft(CONTRAST * np.cos(4 * np.pi * motion / wavelength + theta), axis=0)[
                list(world.harmonics)
            ]
            / len(TIMES)
        )
        found += NOISE * (rng.normal(size=found.shape) + 1j * rng.normal(size=found.shape))
        groups[laser] = measurement.harmonic_map(
            axis,
            axis,
            world.harmonics,
            found,
            noise_sd=NOISE,
            wavelength=wavelength,
            drive_frequency=float(modes.frequency[0]),
        )
    measurement.write(measurement.bundle(groups, geometry="square-270um"), path)
    return path


@pytest.mark.parametrize(
    "lasers", [("red",), pytest.param(("red", "green"), marks=pytest.mark.slow)]
)
def test_rings_of_the_readout_are_not_taken_for_motion(
    lasers: tuple[str, ...], tmp_path: Path
) -> None:
    found = diagnose(simulate(READOUT, lasers, tmp_path / "rings.nc"))
    assert (found.verdict, found.causes) == ("adequate", ()), found.where
    assert found.parameters["base"]["amplitude"].value == pytest.approx(446e-9, rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("lasers", [("red",), ("red", "green")])
def test_overtones_of_the_motion_are_named_and_measured_in_metres(
    lasers: tuple[str, ...], tmp_path: Path
) -> None:
    found = diagnose(simulate(MOTION, lasers, tmp_path / "rings.nc"))
    assert (found.verdict, found.causes) == ("explained", ("mechanical_overtones",)), found.where
    own = found.parameters["mechanical_overtones"]
    for name, truth in (("cos2", 12e-9), ("cos3", 8e-9)):
        assert abs(own[name].value - truth) < 4 * own[name].sd
        assert own[name].sd < 0.2 * truth


@pytest.mark.slow
def test_a_faint_second_harmonic_alone_does_not_decide(tmp_path: Path) -> None:
    found = diagnose(simulate(FAINT, ("red",), tmp_path / "rings.nc"))
    assert found.verdict == "ambiguous", found.causes
    assert len(found.alternatives) > 1
