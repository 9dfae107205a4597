"""Figures of measurement files: one for each group, whatever its kind."""

from collections.abc import Callable

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from femnl.core.errors import numbers_of
from femnl.core.kinds import function, kind_of
from femnl.io.measurement import controls
from femnl.observe.decay.record import decibels
from femnl.plot.style import (
    COLOURS,
    INK,
    as_written,
    axis_label,
    new_figure,
    panel_letters,
    prefixed,
    style,
)

_CLOSE = 0.035  # of the axis: labels of lines nearer than this share one place


def figures(tree: xr.DataTree, outline: ArrayLike | None = None) -> dict[str, Figure]:
    """Draw every measurement of a file.

    Args: tree: as from `femnl.io.measurement.read`; outline: closed polyline (n, 2) of the membrane
    [m], drawn into maps.
    Returns: group name → Figure.
    """
    found = {}
    for name, node in tree.children.items():
        with numbers_of(name):
            found[name] = figure(node.to_dataset(), outline)
    return found


def figure(dataset: xr.Dataset, outline: ArrayLike | None = None) -> Figure:
    """Draw one measurement of any kind; outline [m] goes where places are drawn."""
    spec = kind_of(dataset)
    draw: Callable[..., Figure] = function(spec.figure)
    return draw(dataset, outline) if spec.places else draw(dataset)


def spectrum_figure(dataset: xr.Dataset) -> Figure:
    """Draw a `spectrum`: a line for each mode, as high as its quality factor where known."""
    frequency = dataset["frequency"].values
    divisor, unit = prefixed(frequency, "Hz")
    quality = dataset["quality_factor"].values if "quality_factor" in dataset else None
    if quality is not None and not np.isfinite(quality).any():
        quality = None
    with style():
        result = new_figure(height=3.0 if quality is not None else 2.2)
        axes = result.subplots()
        height = np.ones_like(frequency) if quality is None else quality
        known = np.isfinite(height)
        floor = 0.0 if quality is None else 10 ** np.floor(np.log10(np.nanmin(height)) - 0.3)
        axes.vlines(
            frequency[known] / divisor, floor, height[known], color=COLOURS[0], linewidth=1.2
        )
        axes.plot(frequency[known] / divisor, height[known], "o", color=COLOURS[0])
        if quality is None:
            axes.set_ylim(0, 1.35)
            axes.set_yticks([])
            axes.spines["left"].set_visible(False)
        else:
            if "quality_factor_sd" in dataset:
                axes.errorbar(
                    frequency / divisor,
                    height,
                    dataset["quality_factor_sd"].values,
                    fmt="none",
                    color=INK,
                    linewidth=0.7,
                )
            axes.set_yscale("log")
            axes.set_ylim(floor, np.nanmax(height) * (np.nanmax(height) / floor) ** 0.22)
            axes.set_ylabel("quality factor")
        axes.set_xlabel(axis_label("frequency", unit))
        axes.margins(x=0.05)
        if "label" in dataset.coords:
            _label_lines(
                axes, frequency / divisor, np.where(known, height, floor), dataset["label"].values
            )
    return result


def _label_lines(
    axes: Axes, x: NDArray[np.float64], y: NDArray[np.float64], labels: NDArray[np.object_]
) -> None:
    """Write labels above the lines.

    Those of close neighbours stand one above the other over the taller.
    """
    order = np.argsort(x)
    low, high = axes.get_xlim()
    clusters: list[list[int]] = []
    for index in order:
        if clusters and x[index] - x[clusters[-1][-1]] < _CLOSE * (high - low):
            clusters[-1].append(int(index))
        else:
            clusters.append([int(index)])
    for cluster in clusters:
        words = "\n".join(f"({as_written(labels[index])})" for index in cluster if labels[index])
        axes.annotate(
            words,
            (float(np.mean(x[cluster])), float(np.max(y[cluster]))),
            (0, 4),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=7.5,
        )


def decay_figure(dataset: xr.Dataset) -> Figure:
    """Draw a `decay`: power in dB against time."""
    time = dataset["time"].values
    divisor, unit = prefixed(time, "s")
    with style():
        result = new_figure(height=2.8)
        axes = result.subplots()
        axes.plot(time / divisor, decibels(dataset), linewidth=0.8)
        axes.set(xlabel=axis_label("time", unit), ylabel=axis_label("power", "dB"))
    return result


def series_figure(dataset: xr.Dataset) -> Figure:
    """Draw a `series`: relative change of frequency, and quality factor.

    Against the first control variable that varies.
    """
    control, unit = next(iter(controls(dataset).items()))
    x = dataset[control].values
    drawn = [key for key in ("frequency", "quality_factor") if key in dataset]
    logarithmic = bool(np.all(x > 0) and x.max() > 50 * x.min())
    divisor, unit = (1.0, unit) if logarithmic else prefixed(x, unit)
    with style():
        result = new_figure(height=1.0 + 1.7 * len(drawn))
        panels = result.subplots(len(drawn), 1, sharex=True, squeeze=False).ravel()
        for colour, axes, key in zip(COLOURS, panels, drawn, strict=False):
            values = dataset[key].values
            sd = dataset[f"{key}_sd"].values if f"{key}_sd" in dataset else None
            if key == "frequency":
                centre, unit_f = prefixed(np.nanmedian(values), "Hz")
                middle = float(np.nanmedian(values))
                values = (values / middle - 1) * 1e6
                sd = None if sd is None else sd / middle * 1e6
                axes.set_ylabel(f"(f − f̃)/f̃ (ppm)\nf̃ = {middle / centre:.7g} {unit_f}")
            else:
                axes.set_ylabel("quality factor")
                if np.nanmax(values) > 30 * np.nanmin(values):
                    axes.set_yscale("log")
            axes.errorbar(
                x / divisor,
                values,
                sd,
                fmt="o-",
                color=colour,
                ecolor=INK,
                elinewidth=0.8,
                capsize=2,
                linewidth=0.6,
            )
        if logarithmic:
            panels[-1].set_xscale("log")
        panels[-1].set_xlabel(axis_label(control.replace("_", " "), unit))
        if len(drawn) > 1:
            panel_letters(list(panels))
    return result
