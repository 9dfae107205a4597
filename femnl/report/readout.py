"""The optical part of the page.

Harmonic maps and spectra of the driven fundamental mode, sine against multilayer fringe.
"""

from dataclasses import dataclass, replace

import numpy as np

from femnl.core.device import Stack
from femnl.core.numbers import plain
from femnl.core.readout import HarmonicMap
from femnl.device.geometry.curves import polyline
from femnl.io import measurement
from femnl.optics.fringe import MultilayerFringe, SineFringe
from femnl.optics.harmonics import Fringe, harmonics
from femnl.pipeline import harmonic_maps
from femnl.plot.maps import harmonic_map_figure
from femnl.plot.spectrum import harmonic_spectrum_figure
from femnl.report.mechanics import Geometry, Row, Say
from femnl.report.picture import Picture, embed
from femnl.report.published import Drive, Published

HARMONICS = 6
POINTS = 101
ORDERS = np.arange(1, 26)
LEVEL = 0.01


@dataclass(frozen=True)
class Maps:
    """The maps of one drive: numbers, a picture for each fringe, and a table by harmonic."""

    drive: Drive
    amplitude: str
    pictures: list[Picture]
    rows: list[Row]


@dataclass(frozen=True)
class Spectrum:
    """The harmonics at the antinode, and the highest one that was published.

    What each fringe gives for it, the sine at its best θ.
    """

    picture: Picture
    drive: Drive
    highest: int | None
    sine: str
    multilayer: str


def fringes(stack: Stack, wavelength: float) -> tuple[SineFringe, MultilayerFringe]:
    """Return the stack's fringe, 1 V at full reflection, and its mean and first term.

    The latter is a sine.
    """
    multilayer = MultilayerFringe(stack, wavelength)
    mean, first = multilayer.fourier.coefficients[:2]
    return SineFringe(
        wavelength, float(mean.real), float(abs(first)), float(np.angle(first))
    ), multilayer


def maps(geometry: Geometry, stack: Stack, drive: Drive, say: Say) -> Maps:
    """Predict the maps of harmonics 1f to 6f of the fundamental mode for one published drive."""
    say(f"{geometry.model.name}: harmonic maps, {drive.laser}")
    amplitude = drive.z * drive.wavelength / (4 * np.pi)
    pictures = []
    results = []
    sine, multilayer = fringes(stack, drive.wavelength)
    kinds: dict[str, Fringe] = {"sine": sine, "multilayer": multilayer}
    for name, fringe in kinds.items():
        result = harmonic_maps(
            geometry.modes,
            0,
            fringe,
            amplitude,
            drive.wavelength,
            harmonics=HARMONICS,
            points=POINTS,
        )
        results.append(result)
        pictures.append(_picture(geometry, drive, name, result))
    return Maps(drive, f"{amplitude * 1e9:.2f} nm", pictures, _compare(*results))


def _picture(geometry: Geometry, drive: Drive, name: str, result: HarmonicMap) -> Picture:
    dataset = measurement.harmonic_map(
        result.x, result.y, result.harmonic, result.values, wavelength=drive.wavelength
    )
    words = (
        f"Harmonic maps 1f to {HARMONICS}f of {geometry.model.name}, {drive.laser} laser, "
        f"{name} fringe"
    )
    title = f"{drive.laser} laser, z = {drive.z:g}, {name} fringe"
    return embed(
        harmonic_map_figure(dataset, polyline(geometry.model.outline), title),
        words,
        f"{words}; 1 V is full reflection.",
    )


def _compare(sine: HarmonicMap, multilayer: HarmonicMap) -> list[Row]:
    """Return the largest |V_n| of each fringe and the rms of their difference, by harmonic.

    The rms is given over that of the multilayer's map.
    """
    rows: list[Row] = []
    for n, one, other in zip(sine.harmonic, sine.values, multilayer.values, strict=True):
        difference = np.sqrt(np.nanmean(np.abs(one - other) ** 2) / np.nanmean(np.abs(other) ** 2))
        rows.append(
            (
                f"{n}f",
                plain(np.nanmax(np.abs(one)), 3),
                plain(np.nanmax(np.abs(other)), 3),
                f"{difference * 100:.0f} %",
            )
        )
    return rows


def spectrum(stack: Stack, drive: Drive, published: Published) -> Spectrum:
    """Compare the harmonics at the antinode, where the modulation is z, for both fringes."""
    amplitude = drive.z * drive.wavelength / (4 * np.pi)
    sine, multilayer = fringes(stack, drive.wavelength)
    strengths = {
        "sine, first Fourier term of the stack": _relative(sine, amplitude),
        "multilayer stack": _relative(multilayer, amplitude),
    }
    figure = harmonic_spectrum_figure(ORDERS, strengths, LEVEL)
    picture = embed(
        figure,
        f"Harmonics at the antinode for z = {drive.z:g}",
        "Harmonics at the antinode, relative to the strongest one.",
    )
    if published.highest is None:
        return Spectrum(picture, drive, None, "", "")
    # Odd harmonics are strongest at θ = 90°, even ones at 0.
    best = replace(sine, phase=np.pi / 2 * (published.highest % 2))
    values = [
        plain(_relative(fringe, amplitude)[published.highest - 1], 2)
        for fringe in (best, multilayer)
    ]
    return Spectrum(picture, drive, published.highest, *values)


def _relative(
    fringe: Fringe, amplitude: float
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    strength = np.abs(harmonics(fringe, ORDERS, amplitude))
    return np.asarray(strength / strength.max())
