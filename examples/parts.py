"""
Trampolines, webs and soft-clamped films
========================================

Kinds of device that ship as a few lengths each. The film is blue and ends free at its thin edges;
it is clamped at the thick ones. `femnl geometries` lists their values.
"""

import numpy as np
from matplotlib.patches import PathPatch
from matplotlib.path import Path

import femnl
from femnl.core.device import Model
from femnl.device.geometry import curves
from femnl.plot.style import new_figure, style

PARTS = (
    "trampoline",
    "dandelion",
    "spider-web",
    "soft-clamped-honeycomb",
    "soft-clamped-square",
    "lotus",
)


def film(model: Model) -> Path:
    """The film as one path, holes walked the other way round."""
    angle = np.linspace(0, -2 * np.pi, 49)
    circle = model.holes.radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    loops = [curves.polyline(model.outline), *(c + circle for c in model.holes.centres)]
    loops += [curves.polyline(opening)[::-1] for opening in model.openings]
    return Path.make_compound_path(*(Path(1e6 * loop, closed=True) for loop in loops))


with style():
    figure = new_figure(7.2, 4.9)
    for axes, name in zip(figure.subplots(2, 3).flat, PARTS, strict=True):
        model = femnl.load(name)
        axes.add_patch(PathPatch(film(model), facecolor="C0", linewidth=0.3))
        for segment in model.outline.segments:
            if segment.clamped:
                x, y = 1e6 * curves.point_at(segment, np.linspace(0, 1, 17)).T
                axes.plot(x, y, color="black", linewidth=2.5)
        axes.set(aspect="equal", title=name, xlabel="x (µm)", ylabel="y (µm)")
