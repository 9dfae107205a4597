"""Pictures of a chip: its map with what each device deviates by, and the devices in a row."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from femnl.chip.result import ChipFit, Deviation, Quantity
from femnl.plot.style import (
    COLOURS,
    DIVERGING,
    INK,
    WIDTH,
    as_written,
    axis_label,
    new_figure,
    style,
)

FARTHEST = 4.0
"""How much farther than all others devices that deviate are drawn at most."""
MARGIN = 0.12
LEAST_SIDE = 0.4
"""Of the longer side of a map, what the shorter one has at least."""
MAPS = 60
"""Devices up to which their names stand in a map."""


def chip_figure(fit: ChipFit) -> Figure:
    """Draw, for frequency and quality factor, the map over the chip and what it leaves.

    On the left each device's value against the mean of its design, in colour; in the middle what
    the others of the chip leave of it; on the right measured against predicted.
    """
    quantities = [q for q in (fit.frequency, fit.quality) if q is not None]
    placed = bool(np.isfinite([d.place for d in fit.frequency.devices]).all())
    columns = 3 if placed else 1
    with style():
        width = 1.35 * WIDTH if placed else 0.5 * WIDTH
        figure = new_figure(width, 2.9 * len(quantities))
        rows = figure.subplots(len(quantities), columns, squeeze=False)
        for axes, quantity in zip(rows, quantities, strict=True):
            if placed:
                # The first mode of each device stands for it
                first = _first(quantity)
                means = {name: p.value for name, p in quantity.means.items()}
                whole = [
                    100 * np.log(d.value / means.get(f"{d.design} {d.mode}", d.value))
                    for d in first
                ]
                left = [100 * d.log_ratio for d in first]
                limit = float(np.percentile(np.abs(whole), 90)) or 1.0
                _map(axes[0], first, whole, limit, fit.place_unit)
                _map(axes[1], first, left, limit, fit.place_unit)
                axes[0].set_title(f"{quantity.name}: % off its design", fontsize=8)
                axes[1].set_title("% off its chip", fontsize=8)
            _compare(axes[-1], quantity)
    return figure


def _first(quantity: Quantity) -> list[Deviation]:
    found: dict[str, Deviation] = {}
    for one in quantity.devices:
        found.setdefault(one.device, one)
    return [*found.values()]


def _map(
    axes: Axes, devices: Sequence[Deviation], values: Sequence[float], limit: float, unit: str
) -> None:
    """Draw devices at their places: colours are values, rings are devices that deviate."""
    factor, shown = (1e3, "mm") if unit == "m" else (1.0, unit)
    place = factor * np.array([d.place for d in devices])
    dots: Any = axes.scatter(
        place[:, 0],
        place[:, 1],
        c=values,
        cmap=DIVERGING,
        vmin=-limit,
        vmax=limit,
        s=170,
        marker="s",
        linewidth=0,
    )
    odd = np.array([d.odd for d in devices])
    axes.scatter(
        place[odd, 0], place[odd, 1], s=280, facecolors="none", edgecolors=INK, linewidths=1.2
    )
    if len(devices) <= MAPS:
        for d, (x, y), value in zip(devices, place, values, strict=True):
            pale = abs(value) < 0.6 * limit
            axes.annotate(
                as_written(d.device),
                (x, y),
                ha="center",
                va="center",
                fontsize=5,
                color=INK if pale else "white",
            )
    # Devices in a row would leave a panel of no height
    middle = (place.max(axis=0) + place.min(axis=0)) / 2
    half = np.ptp(place, axis=0) / 2
    half = (1 + 2 * MARGIN) * np.maximum(half, LEAST_SIDE * half.max() or 1.0)
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
    axes.set_aspect("equal")
    axes.invert_yaxis()
    axes.set_xlabel(axis_label("x", shown))
    axes.set_ylabel(axis_label("y", shown))
    axes.figure.colorbar(dots, ax=axes, extend="both", shrink=0.8)


def _compare(axes: Axes, quantity: Quantity) -> None:
    """Draw what every device deviates by, with its standard deviation, design by design."""
    ordered = sorted(quantity.devices, key=lambda d: (d.design, d.mode, d.log_ratio))
    groups = sorted({(d.design, d.mode) for d in ordered})
    for k, group in enumerate(groups):
        own = [(i, d) for i, d in enumerate(ordered) if (d.design, d.mode) == group]
        axes.errorbar(
            [i for i, _ in own],
            [100 * d.log_ratio for _, d in own],
            yerr=[100 * d.sd for _, d in own],
            fmt="o",
            markersize=2.5,
            linewidth=0.6,
            color=COLOURS[k % len(COLOURS)],
            label=as_written(f"design {group[0]}, mode {group[1]}"),
        )
    for i, d in enumerate(ordered):
        if d.odd:
            axes.annotate(as_written(d.device), (i, 100 * d.log_ratio), fontsize=6, color=INK)
    axes.axhline(0, color="#999999", linewidth=0.7)
    inner, outer = (
        max((100 * (abs(d.log_ratio) + d.sd) for d in ordered if d.odd == odd), default=0.0)
        for odd in (False, True)
    )
    reach = max(inner, min(outer, FARTHEST * inner)) or 1.0
    axes.set_ylim(-1.4 * reach, 1.4 * reach)
    axes.set_xlabel("device, by design")
    axes.set_ylabel("deviation (%)")
    axes.set_title("each left out, against its chip", fontsize=8)
    if 1 < len(groups) <= 5:
        axes.legend(fontsize=6)
