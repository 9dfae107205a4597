"""
A mode in the gap of a lattice
==============================

Left: waves in a honeycomb of holes, with the gap that no wave has a frequency in. Right: a mode in
the gap, on the defect that six missing holes leave. It fades before it reaches the clamp, so that
it bends little there: its Q is ten times that of a mode next to the edge.
"""

import numpy as np

import femnl
from femnl.core import resources
from femnl.device import geometry
from femnl.mechanics.modes.quality import solve_quality
from femnl.plot.style import new_figure, style

# Smaller than the shipped one, for the sake of time
text = resources.find_shipped("soft-clamped-honeycomb").read_text(encoding="utf-8")
text = text.replace("[15, 17]", "[7, 9]").replace('"2500 um"', '"1250 um"')
model = geometry.parse(text.replace('"2400 um"', '"1300 um"'))
bands = femnl.solve_bands(model, count=4, steps=5)
modes = femnl.solve_modes_near(model, 1.65e6, count=5, resolution=0.3)
quality = solve_quality(modes)
best = int(np.argmax(quality.total))

with style():
    figure = new_figure(7.2, 3.2)
    left, right = figure.subplots(1, 2)
    way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(bands.wave, axis=0), axis=1))])
    left.plot(way, bands.frequency / 1e6, color="C0")
    for low, high in bands.gaps:
        left.axhspan(low / 1e6, high / 1e6, color="#E9E4D6")
    for k, frequency in enumerate(modes.frequency / 1e6):
        color = "C1" if k == best else "0.6"
        left.axhline(frequency, color=color, linewidth=1, linestyle="--")
    left.set_xticks([way[place] for _, place in bands.corners], [name for name, _ in bands.corners])
    left.set(xlim=(0, way[-1]), ylim=(0, None), ylabel="frequency (MHz)")
    x, y = np.linspace(-625e-6, 625e-6, 301), np.linspace(-650e-6, 650e-6, 301)
    shape = femnl.shape_at(modes, best, x[None, :], y[:, None])
    right.imshow(
        np.ma.masked_equal(shape, 0),
        extent=(-625, 625, -650, 650),
        origin="lower",
        cmap="RdBu_r",
        vmin=-1,
        vmax=1,
    )
    title = f"{modes.frequency[best] / 1e6:.3f} MHz, Q = {quality.total[best]:.1e}"
    right.set(title=title, xlabel="x (µm)", ylabel="y (µm)")
