"""
Waves in a lattice of holes
===========================

Far from the edge a perforated film carries waves. Long waves see an even film (dashed). Short waves
see each hole. Narrow bridges between the holes flatten the bands of frequencies and separate them.
"""

from dataclasses import replace

import numpy as np

import femnl
from femnl.plot.style import new_figure, style

model = femnl.load("square-270um-perforated")

with style():
    figure = new_figure(7.2, 3.2)
    panels = figure.subplots(1, 2, sharey=True)
    for axes, radius in zip(panels, (0.9e-6, 4.0e-6), strict=True):
        bands = femnl.solve_bands(
            replace(model, holes=replace(model.holes, radius=radius)),
            count=5,
            steps=8,
            resolution=0.7,
        )
        way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(bands.wave, axis=0), axis=1))])
        axes.plot(way, bands.frequency / 1e6, color="C0")
        axes.plot(
            way,
            bands.speed[0] * np.linalg.norm(bands.wave, axis=1) / (2e6 * np.pi),
            "--",
            color="C1",
        )
        for low, high in bands.gaps:
            axes.axhspan(low / 1e6, high / 1e6, color="#E9E4D6")
        axes.set_xticks(
            [way[place] for _, place in bands.corners], [name for name, _ in bands.corners]
        )
        axes.set(
            xlim=(0, way[-1]),
            ylim=(0, 100),
            title=f"radius {radius * 1e6:g} µm, long waves {bands.speed[0]:.0f} m/s",
        )
    panels[0].set_ylabel("f (MHz)")
