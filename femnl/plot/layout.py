"""A layout with what is wrong marked, and the film's stress after release."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from femnl.core.device import Model
from femnl.core.numbers import plain
from femnl.core.outline import Holes, Outline
from femnl.device.geometry.curves import point_at, polyline, turn
from femnl.mechanics.compression import ReleasedStress
from femnl.plot.style import COLOURS, DIVERGING, INK, new_figure, style

Array = NDArray[np.float64]

UM = 1e6
WRONG = COLOURS[1]
CLAMPED = 2.2  # points of line where the film is held, thrice that where it ends free
FREE = 0.7
CIRCLE = np.stack([np.cos(np.linspace(0, 2 * np.pi, 49)), np.sin(np.linspace(0, 2 * np.pi, 49))], 1)


def layout_figure(model: Model, stress: ReleasedStress) -> Figure:
    """Draw a device and beside it the smaller principal stress after release.

    Bold edges are clamped. Compression is drawn in blue.
    """
    with style():
        figure = new_figure(height=3.6)
        drawn, released = figure.subplots(1, 2, sharex=True, sharey=True)
        _draw_film(drawn, polyline(model.outline), model.holes, model.openings)
        for lamina in model.layers:
            _draw_rims(drawn, lamina.rims)
        _draw_edges(drawn, model.outline)
        drawn.set_title(f"{model.name}: bold edges are clamped")
        values = stress.least * 1e-6
        largest = float(np.abs(values).max()) or 1.0
        compressed = bool(values.min() < 0)
        # Red is tension, whether or not something is compressed, or everything is
        low = float(values.min()) if compressed else -largest
        high = float(values.max()) if values.max() > 0 else largest
        scale = TwoSlopeNorm(0.0, low, high)
        map_ = PolyCollection(
            list(stress.corners * UM), array=values, cmap=DIVERGING, norm=scale, edgecolors="face"
        )
        map_.set(linewidth=0.1, rasterized=True)
        released.add_collection(map_)
        bar = figure.colorbar(map_, ax=released, label="smaller principal stress (MPa)", shrink=0.8)
        if not compressed:
            bar.ax.set_ylim(0.0, high)
        ticks = [*([low, low / 2] if compressed else []), 0.0, high / 2, high]
        bar.set_ticks(ticks, labels=[plain(tick, 4) for tick in ticks])
        released.set_title("after release")
        if stress.compressed.any():
            _, point = stress.worst
            _mark(released, [(float(point[0]), float(point[1]))])
        for panel in (drawn, released):
            panel.set(aspect="equal", xlabel="x (µm)", ylabel="y (µm)")
    return figure


def faults_figure(
    outlines: Sequence[Array],
    holes: Holes,
    openings: Sequence[Outline],
    points: Sequence[tuple[float, float]],
    title: str,
) -> Figure:
    """Draw what a file draws, with rings around the places (x, y) [m] that are wrong.

    Args:
        outlines: (n, 2) [m] of each region.
        holes: round holes.
        openings: other inner edges.
        points: what to mark.
        title: of the picture.
    """
    with style():
        figure = new_figure(4.6, 4.6)
        axes = figure.subplots()
        for outline in outlines:
            _draw_film(axes, outline, holes, openings)
        _mark(axes, points)
        axes.set(aspect="equal", xlabel="x (µm)", ylabel="y (µm)", title=title)
        axes.autoscale_view()
    return figure


def _draw_film(axes: Axes, outline: Array, holes: Holes, openings: Sequence[Outline]) -> None:
    axes.fill(*outline.T * UM, facecolor="0.9", edgecolor=INK, linewidth=FREE)
    rims = [(centre + holes.radius * CIRCLE) * UM for centre in holes.centres]
    rims += [polyline(opening) * UM for opening in openings]
    if rims:
        shapes = PolyCollection(rims, facecolors="white", edgecolors=INK, linewidths=0.4)
        axes.add_collection(shapes)


def _draw_rims(axes: Axes, rims: Sequence[Outline]) -> None:
    """Draw the rims of a layer within what is drawn of the film already."""
    limits = axes.dataLim.frozen()
    for rim in rims:
        axes.plot(*polyline(rim).T * UM, "-", color=COLOURS[2], linewidth=1.0)
    axes.dataLim.set(limits)


def _draw_edges(axes: Axes, outline: Outline) -> None:
    lines = []
    widths = []
    for segment in outline.segments:
        pieces = 1 + int(abs(turn(segment)) / np.radians(4))
        lines.append(point_at(segment, np.linspace(0, 1, pieces + 1)) * UM)
        widths.append(CLAMPED if segment.clamped else FREE)
    axes.add_collection(LineCollection(lines, colors=INK, linewidths=widths))


def _mark(axes: Axes, points: Sequence[tuple[float, float]]) -> None:
    for number, (x, y) in enumerate(points, start=1):
        axes.plot(
            x * UM, y * UM, "o", markersize=14, markeredgewidth=1.6, fillstyle="none", color=WRONG
        )
        axes.annotate(
            str(number), (x * UM, y * UM), (9, 9), textcoords="offset points", color=WRONG
        )
