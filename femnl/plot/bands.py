"""Bands of waves along a path of wave vectors."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from femnl.io.results.atomic import write_whole
from femnl.mechanics.bands import Bands
from femnl.mechanics.bands.words import speeds
from femnl.plot.style import COLOURS, INK, new_figure, prefixed, style

DPI = 200


def bands_figure(bands: Bands) -> Figure:
    """Draw frequency along the path, long waves as a dashed line, gaps shaded."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(bands.wave, axis=0), axis=1))])
    divisor, unit = prefixed(bands.frequency, "Hz")
    top = 1.05 * bands.frequency.max() / divisor
    with style():
        figure = new_figure(4.6, 3.6)
        axes = figure.add_subplot()
        for low, high in bands.gaps:
            axes.axhspan(low / divisor, high / divisor, color="#E9E4D6", linewidth=0)
        for _, place in bands.corners[1:-1]:
            axes.axvline(way[place], color=INK, linewidth=0.5)
        axes.plot(way, bands.frequency / divisor, color=COLOURS[0])
        still = np.all(bands.wave == 0, axis=1)
        speed = bands.speed_along(np.where(still[:, None], bands.axes[0], bands.wave))
        long = speed * np.linalg.norm(bands.wave, axis=1) / (2 * np.pi * divisor)
        axes.plot(
            way,
            long,
            color=COLOURS[1],
            linestyle=(0, (4, 3)),
            linewidth=0.9,
            label=f"long waves, {speeds(bands, 1)}",
        )
        axes.set_xlim(way[0], way[-1])
        axes.set_ylim(0, top)
        if bands.corners:
            axes.set_xticks(
                [way[place] for _, place in bands.corners], [name for name, _ in bands.corners]
            )
        else:
            axes.set_xlabel("way along the wave vectors (rad/m)")
        axes.set_ylabel(f"f ({unit})")
        axes.set_title(
            f"{bands.lattice.kind} lattice, pitch {bands.lattice.pitch * 1e6:.4g} µm", loc="left"
        )
        figure.legend(loc="outside lower center")
    return figure


def draw_bands(bands: Bands, out: Path) -> None:
    """Write the picture of `bands_figure` to a PNG, PDF or SVG file."""
    figure = bands_figure(bands)
    write_whole(out, lambda file: figure.savefig(file, dpi=DPI))
