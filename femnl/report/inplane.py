"""The film in its own plane while a mode is deflected.

How the edge decides what it may give way to.
"""

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from femnl.core.device import Edge
from femnl.core.modes import Modes
from femnl.device.geometry.curves import polyline
from femnl.io.results.surface import unfold
from femnl.mechanics.nonlinearity import in_plane_response
from femnl.plot.style import INK, SEQUENTIAL, new_figure, style
from femnl.report.shape import FLAT

DEFLECTION = 1e-6
"""Deflection of the mode [m] that the picture is for; displacements go as its square."""
ARROWS = 15
"""Arrows along each side."""


def in_plane_figure(
    modes: Modes, index: int = 0, edges: tuple[Edge, ...] = ("clamped", "sliding")
) -> Figure:
    """Draw the in-plane displacement of the film under each edge while a mode is deflected by 1 µm.

    Size in colour, arrows along it.
    """
    outline = polyline(modes.domain.model.outline) * 1e6
    fields = {}
    for edge in edges:
        moved = replace(
            modes.prestress,
            degree=modes.degree,
            displacement=in_plane_response(modes, index, edge) * DEFLECTION**2,
        )
        # Which mirrors any displacement over the whole film
        fields[edge] = unfold(replace(modes, prestress=moved))
    largest = max(float(np.hypot(*surface.in_plane.T).max()) for surface in fields.values()) * 1e9
    with style():
        figure = new_figure(height=3.4)
        panels = figure.subplots(1, len(edges), squeeze=False)[0]
        for axes, (edge, surface) in zip(panels, fields.items(), strict=True):
            x, y = surface.points.T * 1e6
            film = Triangulation(x, y, surface.triangles[:, FLAT].reshape(-1, 3))
            size = np.hypot(*surface.in_plane.T) * 1e9
            shown = axes.tripcolor(
                film,
                size,
                shading="gouraud",
                cmap=SEQUENTIAL,
                vmin=0,
                vmax=largest,
                rasterized=True,
            )
            some = _spread(surface.points)
            axes.quiver(
                x[some],
                y[some],
                *surface.in_plane[some].T * 1e9,
                color="white",
                scale=ARROWS * largest,
                width=0.006,
                ec=INK,
                lw=0.4,
            )
            axes.fill(*outline.T, fill=False, edgecolor=INK, linewidth=0.8)
            axes.set_aspect("equal")
            axes.set(title=f"{edge} edges", xlabel="x (µm)", ylabel="y (µm)")
        figure.colorbar(shown, ax=list(panels), label="in-plane displacement (nm)")
    return figure


def _spread(
    points: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
    """Return nodes that lie about evenly over the film.

    They are the nodes nearest to the centre of each square of a grid.
    """
    low = points.min(axis=0)
    width = np.ptp(points, axis=0).max() / ARROWS
    cell = np.floor((points - low) / width).astype(np.int64)
    off = np.hypot(*((points - low) / width - cell - 0.5).T)
    order = np.lexsort((off, cell[:, 1], cell[:, 0]))
    first = np.unique(cell[order], axis=0, return_index=True)[1]
    return order[first]
