"""
A study of 200 designs
======================

Rows of holes fill a square film of 100 µm. The study shows how they set its frequencies, its
nonlinearity and its losses. The tables come from `femnl sweep` on `design-study.toml`. The mesher
refused a few designs at this coarse resolution; the figure leaves them out. The cloud around each
line is the upper estimate of its discretisation error.
"""

from pathlib import Path

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm

import femnl
from femnl.plot.style import SEQUENTIAL, new_figure, panel_letters, style

with xr.open_dataset(
    Path(femnl.__file__).parents[1] / "examples" / "design-study.nc", engine="h5netcdf"
) as study:
    study.load()
radius = study["holes.radius"].values * 1e6
pitch = study["holes.pitch"].values * 1e6
first = study.sel(mode=1)
fourth = study.sel(mode=4)
panels = (
    ("f₁₁ (MHz)", first.frequency / 1e6, first.frequency_error / 1e6),
    ("f₂₂/f₁₁", fourth.ratio, fourth.ratio_error),
    ("α₁₁ (10⁻³ µm⁻²)", first.alpha * 1e-9, first.alpha_error * 1e-9),
    ("Q₁₁ over Q of bending", first.dilution, first.dilution_error),
)
colours = mpl.colormaps[SEQUENTIAL]
scale = LogNorm(pitch.min(), pitch.max() * 1.1)
with style():
    figure = new_figure(height=5.2)
    axes = figure.subplots(2, 2, sharex=True).ravel()
    for panel, (name, value, error) in zip(axes, panels, strict=True):
        for one in np.unique(pitch):
            row = (pitch == one) & np.isfinite(value.values)
            colour = colours(scale(one))
            panel.plot(radius[row], value[row], ".-", color=colour)
            panel.fill_between(
                radius[row],
                (value - error)[row],
                (value + error)[row],
                color=colour,
                alpha=0.15,
                linewidth=0,
            )
        panel.set_ylabel(name)
        low = float(value.min())
        high = float(value.max())
        panel.set_ylim(low - 0.2 * (high - low), high + 0.2 * (high - low))
    for panel in axes[2:]:
        panel.set_xlabel("radius of the holes (µm)")
    panel_letters(axes)
    bar = figure.colorbar(ScalarMappable(scale, colours), ax=axes, label="pitch (µm)", shrink=0.6)
    bar.set_ticks([10, 15, 20, 30], labels=["10", "15", "20", "30"], minor=False)
    bar.minorticks_off()
