"""Data, what each model predicts, and what it leaves in σ, side by side and in the same colours."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from numpy.typing import NDArray

from femnl.core.comparison import Comparison, Curves, Images
from femnl.optics.harmonics import signal_phase
from femnl.plot.style import (
    COLOURS,
    DIVERGING,
    INK,
    as_written,
    axis_label,
    new_figure,
    prefixed,
    scale_bar,
    style,
    symmetric_limit,
)

Array = NDArray[np.float64]
WIDE = 9.6
"""Width [inch] of a figure that fills a page on a screen."""
LINES = ("--", "-", ":")
SIGNS = ("_", "x", "+")
"""Line styles and signs of the models, in their order: the base is dashed."""
NOISE = 3.0
"""Residuals in σ up to which an axis is linear; noise stays within."""
EXCLUDED = "#c62828"
"""Colour of data that no fit has seen."""
FAINTEST = 5.0
"""Smallest limit, in σ, of the colours of residuals, so that noise looks like noise."""


@dataclass(frozen=True)
class Across:
    """The axis along the data: its name and unit, and where its zero [SI] and its unit are."""

    name: str
    unit: str
    zero: float
    divisor: float

    def place(self, x: Array) -> Array:
        """Return values [SI] in the unit of the axis, from its zero."""
        return (x - self.zero) / self.divisor


def comparison_figure(comparison: Comparison) -> Figure:
    """Draw a comparison of data with models. Returns: the Figure."""
    with style():
        return _images(comparison) if isinstance(comparison, Images) else _curves(comparison)


def _curves(found: Curves) -> Figure:
    """Draw data and models on top, and below what each model leaves, on one scale."""
    count = len(found.models)
    figure = new_figure(WIDE, 3.2 + 1.25 * count)
    ratios = {"height_ratios": [2.2, *[1.0] * count]}
    top, *below = figure.subplots(1 + count, 1, sharex=True, gridspec_kw=ratios)
    across = axis_across(found)
    if _of_modes(found):
        _deviations(top, found, across)
    else:
        _predictions(top, found, across)
    _name_excluded(top, found)
    top.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=4)
    largest = 0.0
    for number, (axes, name) in enumerate(zip(below, found.models, strict=True)):
        for k, curve in enumerate(found.curves):
            away = (curve.data - curve.predictions[number]) / curve.sd
            largest = max(largest, float(np.nanmax(np.abs(away))))
            colour = COLOURS[number if _of_modes(found) else k % len(COLOURS)]
            _points(
                axes, across.place(curve.x), away, curve.excluded, colour, as_written(curve.name)
            )
        axes.set_title(f"left by {name} (σ)", fontsize=8)
    for axes in below:
        residual_axis(axes, largest)
    below[-1].set_xlabel(axis_label(across.name, across.unit))
    if found.ticks:
        name_ticks(below[-1], found.ticks)
    if 1 < len(found.curves) <= len(COLOURS):
        figure.legend(*below[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _of_modes(found: Curves) -> bool:
    """Whether these are frequencies, mode by mode: only their relative deviation can be seen."""
    return not found.joined and found.y_unit == "Hz"


def _predictions(axes: Axes, found: Curves, across: Across) -> None:
    """Draw the data of each curve with their errors, and what each model predicts."""
    scale, unit = prefixed(np.concatenate([c.data for c in found.curves]), found.y_unit)
    for k, curve in enumerate(found.curves):
        x = across.place(curve.x)
        # Of several curves each has its colour, or nobody could tell which line is whose
        ink = COLOURS[k % len(COLOURS)] if len(found.curves) > 1 else INK
        axes.errorbar(
            x,
            curve.data / scale,
            curve.sd / scale,
            fmt=".",
            markersize=3,
            elinewidth=0.5,
            color=COLOURS[k % len(COLOURS)],
            alpha=0.7,
        )
        out = list(curve.excluded)
        axes.plot(x[out], curve.data[out] / scale, "x", color=EXCLUDED, markersize=5)
        for line, predicted in zip(_marks(found), curve.predictions, strict=False):
            axes.plot(x, predicted / scale, line, color=ink, linewidth=0.9, markersize=7)
    for name, line in zip(found.models, _marks(found), strict=False):
        axes.plot([], [], line, color=INK, label=name)
    axes.plot([], [], ".", color=INK, label="measured")
    axes.set_ylabel(axis_label(found.y, unit))


def _marks(found: Curves) -> tuple[str, ...]:
    """Return how each model is drawn: as a line, or as signs where neighbours do not belong."""
    return LINES if found.joined else SIGNS


def _deviations(axes: Axes, found: Curves, across: Across) -> None:
    """Draw measured over predicted frequency, less one, for each model."""
    (curve,) = found.curves
    x = across.place(curve.x)
    for k, (name, predicted) in enumerate(zip(found.models, curve.predictions, strict=True)):
        away = 1e6 * (curve.data / predicted - 1)
        sd = 1e6 * curve.sd / predicted
        axes.errorbar(x, away, sd, fmt="os^"[k], elinewidth=0.8, color=COLOURS[k], label=name)
        out = list(curve.excluded)
        axes.plot(x[out], away[out], "x", color=EXCLUDED, markersize=6)
    axes.axhline(0, color=INK, linewidth=0.5)
    axes.set_ylabel("measured − predicted (ppm)")


def _points(
    axes: Axes, x: Array, away: Array, excluded: tuple[int, ...], colour: str, name: str
) -> None:
    """Draw residuals in σ; a cross for data that no fit has seen."""
    axes.plot(x, away, ".", markersize=3, color=colour, label=name)
    out = list(excluded)
    axes.plot(x[out], away[out], "x", color=EXCLUDED, markersize=5)


def _name_excluded(axes: Axes, found: Curves) -> None:
    """Say in the legend what the crosses are, where there are any."""
    if any(curve.excluded for curve in found.curves):
        axes.plot([], [], "x", color=EXCLUDED, label="left out as a glitch")


def axis_across(found: Curves) -> Across:
    """Return the axis along the data of a comparison."""
    every = np.concatenate([c.x for c in found.curves])
    zero = _zero(every)
    divisor, unit = (1.0, found.x_unit) if found.ticks else prefixed(every - zero, found.x_unit)
    name = f"{found.x} − {zero:,.9g} {found.x_unit}".replace(",", " ") if zero else found.x
    return Across(name, unit, zero, divisor)


def name_ticks(axes: Axes, ticks: tuple[str, ...]) -> None:
    """Write names below an axis that only counts."""
    turn = 60 if max(map(len, ticks)) > 2 else 0
    axes.set_xticks(np.arange(len(ticks)), ticks, rotation=turn, fontsize=7)


def _zero(x: Array) -> float:
    """A round number near the middle of values that span little of their size; else 0."""
    span = float(np.ptp(x))
    middle = float(np.mean(x))
    if not 0 < span < 0.02 * abs(middle):
        return 0.0
    step = 10.0 ** np.floor(np.log10(span / 2))
    return float(step * np.round(middle / step))


def residual_axis(axes: Axes, largest: float) -> None:
    """±2σ in grey; linear where residuals are small, logarithmic beyond the noise otherwise."""
    axes.axhspan(-2, 2, color="#e8e8e8", zorder=0)
    axes.axhline(0, color=INK, linewidth=0.5)
    if largest <= 4 * NOISE:
        axes.set_ylim(-1.1 * max(largest, NOISE), 1.1 * max(largest, NOISE))
        return
    axes.set_yscale("symlog", linthresh=NOISE)
    axes.set_ylim(-2 * largest, 2 * largest)
    decades = [10.0**n for n in range(1, int(np.log10(2 * largest)) + 1)]
    shown = decades[:: max(1, len(decades) // 2)]
    axes.set_yticks([-v for v in reversed(shown)] + [0.0, *shown])


def _images(found: Images) -> Figure:
    """One row a harmonic: measured, predicted, and what is left in σ.

    For each model; the same colours throughout.
    """
    count = len(found.models)
    columns = 1 + 2 * count
    panel = min(WIDE / columns, 1.9)
    aspect = np.ptp(found.y) / max(np.ptp(found.x), 1e-300)
    figure = new_figure(
        max(panel * columns, 4.6),
        len(found.harmonic) * panel * min(max(aspect, 0.4), 1.6) * 0.98 + 0.5,
    )
    panels = figure.subplots(len(found.harmonic), columns, squeeze=False)
    titles = ["measured", *(text for name in found.models for text in (name, "left (σ)"))]
    for axes, title in zip(panels[0], titles, strict=True):
        axes.set_title(title.replace(" + ", " +\n"), fontsize=7.5)
    rows = zip(
        panels, found.harmonic, found.data, np.moveaxis(found.predictions, 1, 0), strict=True
    )
    for number, (row, n, data, predicted) in enumerate(rows):
        turn = np.exp(-1j * signal_phase(data))
        limit = symmetric_limit((data * turn).real)
        rests = [((data - model) * turn).real / found.noise for model in predicted]
        widest = max(
            FAINTEST, symmetric_limit(np.concatenate([rest.ravel() for rest in rests]), 0.99)
        )
        shown = [(data * turn).real / limit]
        limits = [1.0]
        for model, rest in zip(predicted, rests, strict=True):
            shown += [(model * turn).real / limit, rest]
            limits += [1.0, widest]
        for axes, values, colour in zip(row, shown, limits, strict=True):
            image = paint(axes, found, values, colour)
        ring_excluded(row[0], found, number)
        name_row(row[0], n, limit)
        bar_of_sigma(figure, row[-1], image, widest)
    scale_bar(panels[-1, 0], float(np.ptp(found.x)))
    return figure


def paint(axes: Axes, found: Images, values: Array, limit: float) -> QuadMesh:
    """Draw values (n_y, n_x) over the film; white is zero."""
    image = axes.pcolormesh(
        found.x,
        found.y,
        values,
        cmap=DIVERGING,
        vmin=-limit,
        vmax=limit,
        shading="nearest",
        rasterized=True,
    )
    axes.set_aspect("equal")
    axes.set_facecolor("#e6e6e6")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.spines[:].set_visible(False)
    return image


def ring_excluded(axes: Axes, found: Images, row: int) -> None:
    """Draw a ring around the data of a harmonic that no fit has seen."""
    gone = [(found.x[c], found.y[r]) for k, r, c in found.excluded if k == row]
    if gone:
        axes.plot(*zip(*gone, strict=True), "o", mfc="none", color=INK, ms=4, mew=0.6)


def name_row(axes: Axes, harmonic: int, limit: float) -> None:
    """Write a harmonic and the range [V] of its colours at the left of its row."""
    divisor, unit = prefixed(limit, "V")
    text = f"{harmonic}f\n±{limit / divisor:.3g} {unit}"
    axes.set_ylabel(text, rotation=0, ha="right", va="center", fontsize=7.5)


def bar_of_sigma(figure: Figure, axes: Axes, image: QuadMesh, limit: float) -> None:
    """Draw the colours of a row of residuals, in σ."""
    bar = figure.colorbar(image, ax=axes, shrink=0.8, aspect=14, pad=0.03, ticks=[-limit, 0, limit])
    bar.ax.set_yticklabels([f"−{limit:.3g}", "0", f"{limit:.3g}"], fontsize=6.5)
    bar.outline.set_linewidth(0.5)
