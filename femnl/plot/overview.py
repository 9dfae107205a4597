"""A wide sweep with the lines found in it and the modes they were given to."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from femnl.measurement import amplitude
from femnl.plot.style import COLOURS, INK, axis_label, new_figure, panel_letters, prefixed, style
from femnl.types.spectrum import Assignment, Peaks


def overview_figure(dataset: xr.Dataset, peaks: Peaks, assignment: Assignment | None = None, sweep: int = 0) -> Figure:
    """Draw a wide sweep on a logarithmic scale, the fitted lines in it, their labels; and below how far each lies from its mode.

    Args: dataset of kind `response`; peaks of that sweep; assignment (adds labels and the lower panel).
    Returns: the Figure.
    """
    f, volts = dataset["frequency"].values[sweep], amplitude(dataset).values[sweep]
    divisor, unit = prefixed(f, "Hz")
    scale, volt = prefixed(np.abs(volts), "V")
    labels = [None] * peaks.frequency.size if assignment is None else list(assignment.best.label)
    with style():
        figure = new_figure(height=3.2 if assignment is None else 4.6)
        ratios = [2.4] if assignment is None else [2.4, 1]
        panels = figure.subplots(len(ratios), 1, sharex=True, squeeze=False, height_ratios=ratios)[:, 0]
        upper = panels[0]
        upper.plot(f / divisor, np.abs(volts) / scale, color="#9a9a9a", linewidth=0.7, label="measured")
        upper.plot(
            peaks.points / divisor, np.abs(peaks.prediction) / scale, color=COLOURS[0], linewidth=0.9, label="lines without background"
        )
        low = 0.5 * np.nanquantile(np.abs(volts), 0.01) / scale
        upper.set_yscale("log")
        upper.set_ylim(low, 12 * np.nanmax(np.abs(volts)) / scale)
        upper.set_ylabel(axis_label("magnitude |V|", volt))
        height = 2.0 * np.nanmax(np.abs(volts)) / scale
        places = _spread(peaks.frequency / divisor, 0.02 * float(np.nanmax(f) - np.nanmin(f)) / divisor)
        for frequency, height_of, place, label in zip(
            peaks.frequency / divisor, np.abs(peaks.amplitude) / scale, places, labels, strict=True
        ):
            colour = INK if label is not None or assignment is None else COLOURS[1]
            upper.plot([frequency, frequency, place], [height_of, 0.7 * height, height], color=colour, linewidth=0.5, linestyle=":")
            text = "" if assignment is None else f"({label.strip('()')})" if label else "?"
            upper.text(place, height * 1.1, text, rotation=90, ha="center", va="bottom", fontsize=7, color=colour)
        upper.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
        if assignment is not None:
            _distances(panels[1], peaks, assignment, divisor)
            panel_letters(list(panels))
        panels[-1].set_xlabel(axis_label("drive frequency", unit))
    return figure


def _spread(x: NDArray[np.float64], gap: float) -> NDArray[np.float64]:
    """Places for labels near rising x, at least `gap` apart: neighbours that are too close move aside about their mean."""
    blocks: list[list[float]] = []  # sum of (x − offset), count
    for value in x:
        blocks.append([value, 1.0])
        while len(blocks) > 1 and blocks[-2][0] / blocks[-2][1] + gap * blocks[-2][1] > blocks[-1][0] / blocks[-1][1]:
            total, count = blocks.pop()
            blocks[-1][0] += total - gap * count * blocks[-1][1]
            blocks[-1][1] += count
    starts = [(total / count, int(count)) for total, count in blocks]
    return np.array([start + gap * index for start, count in starts for index in range(count)])


def _distances(axes: Axes, peaks: Peaks, assignment: Assignment, divisor: float) -> None:
    """Measured over scaled simulated frequency, less one; the grey band is the scatter of the simulation."""
    away, share = _share(assignment.deviation)
    axes.axhspan(-assignment.model_sd / share, assignment.model_sd / share, color="#e8e8e8", zorder=0)
    axes.axhline(0, color=INK, linewidth=0.6)
    sd = peaks.frequency_sd / peaks.frequency / share
    axes.errorbar(peaks.frequency / divisor, assignment.deviation / share, sd, fmt="o", color=COLOURS[0], ecolor=INK, elinewidth=0.8)
    axes.set_ylabel(f"f / c f_sim − 1 ({away})")


def _share(values: NDArray[np.float64]) -> tuple[str, float]:
    """Percent, per mille or parts per million, whichever suits the largest of `values`; and its size."""
    largest = np.nanmax(np.abs(values)) if np.isfinite(values).any() else 0.0
    return ("%", 1e-2) if largest > 0.02 else ("‰", 1e-3) if largest > 1e-3 else ("ppm", 1e-6)
