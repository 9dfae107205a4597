"""Harmonics of traces against the frequency of the drive, and the motion that explains them."""

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from femnl.core.fit import MotionFit
from femnl.core.readout import Array, HarmonicSpectrum
from femnl.plot.spectrum import harmonic_spectrum_figure
from femnl.plot.style import (
    COLOURS,
    INK,
    SEQUENTIAL,
    axis_label,
    new_figure,
    panel_letters,
    prefixed,
    style,
)

_FIRST = 5  # harmonics drawn as lines


def harmonics_figure(spectrum: HarmonicSpectrum, motion: MotionFit | None = None) -> Figure:
    """Draw |V_n| over drive frequency and harmonic, the first harmonics as lines.

    With a fit, the amplitude of motion too.

    Args: spectrum: from `femnl.fits.trace.decompose.decompose`; motion: from
    `femnl.fits.trace.spot.fit_spot`.
    Returns: the Figure, against the number of the step where steps share a frequency; for a single
    step the spectrum of its harmonics, with the noise floor.
    """
    size = np.abs(spectrum.values[1:])
    if spectrum.drive_frequency.size == 1:
        return _one_step(spectrum, motion)
    order, drive, drive_label = _drive(spectrum.drive_frequency)
    scale, volt = prefixed(size, "V")
    floor = float(np.median(spectrum.values_sd[1:])) / scale
    with style():
        count = 2 if motion is None else 3
        figure = new_figure(height=1.0 + 1.9 * count)
        panels = figure.subplots(count, 1, sharex=True, height_ratios=[1.4, *[1.0] * (count - 1)])
        image = panels[0].pcolormesh(
            drive,
            spectrum.harmonic[1:],
            np.maximum(size[:, order] / scale, floor),
            norm=LogNorm(floor, float(size.max()) / scale),
            cmap=SEQUENTIAL,
            shading="nearest",
            rasterized=True,
        )
        figure.colorbar(
            image, ax=panels[0], label=f"|Vₙ| ({volt}), from the noise up", aspect=18, pad=0.01
        )
        panels[0].set_ylabel("harmonic n")
        panels[0].yaxis.set_major_locator(MaxNLocator(integer=True))
        for colour, n in zip(COLOURS, range(min(_FIRST, size.shape[0])), strict=False):
            panels[1].semilogy(
                drive,
                size[n, order] / scale,
                color=colour,
                label=f"{spectrum.harmonic[n + 1]}f",
            )
        panels[1].set_ylim(bottom=floor)
        panels[1].set_ylabel(axis_label("|Vₙ|", volt))
        panels[1].legend(ncols=_FIRST, loc="lower right", bbox_to_anchor=(1.0, 1.0))
        if motion is not None:
            metre, name = prefixed(motion.amplitude, "m")
            panels[2].errorbar(
                drive,
                motion.amplitude[order] / metre,
                motion.amplitude_sd[order] / metre,
                fmt="o",
                color=COLOURS[0],
            )
            panels[2].set_ylabel(axis_label("amplitude U", name))
            panels[2].set_ylim(bottom=0)
        panels[-1].set_xlabel(drive_label)
        panel_letters(list(panels))
    return figure


def _drive(frequency: Array) -> tuple[NDArray[np.intp], Array, str]:
    """Return the order of the steps (n_steps,), where they are drawn, and what that is.

    Steps that share a frequency, as of a drive that is raised, are drawn by their number.
    """
    order = np.argsort(frequency, kind="stable")
    if len(np.unique(frequency)) < len(frequency):
        number = np.arange(len(frequency))
        return number, np.asarray(number + 1, float), "step of the drive"
    centre = float(np.median(frequency))
    hertz, name = prefixed(centre, "Hz")
    divisor, unit = prefixed(frequency - centre, "Hz")
    label = axis_label(f"drive frequency − {centre / hertz:.9g} {name}", unit)
    return order, np.asarray((frequency[order] - centre) / divisor), label


def _one_step(spectrum: HarmonicSpectrum, motion: MotionFit | None) -> Figure:
    """The harmonics of one step, relative to the largest, down to the noise."""
    size = np.abs(spectrum.values[1:, 0])
    drawn = {"measured": size} | (
        {} if motion is None else {"fitted": np.abs(motion.prediction[:, 0])}
    )
    floor = float(spectrum.values_sd[1:, 0].mean() / size.max())
    figure = harmonic_spectrum_figure(spectrum.harmonic[1:], drawn)
    axes = figure.axes[0]
    axes.axhline(floor, color=INK, linewidth=0.8, linestyle="--")
    axes.set_ylim(bottom=0.3 * floor)
    axes.annotate(
        "noise",
        (1.0, floor),
        (-4, 3),
        xycoords=("axes fraction", "data"),
        textcoords="offset points",
        fontsize=8,
        ha="right",
    )
    return figure
