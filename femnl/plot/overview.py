"""A wide sweep with the lines found in it and the modes they were given to."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from femnl.core.spectrum import Assignment, FilmFit, Peaks
from femnl.io.measurement import amplitude
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

Array = NDArray[np.float64]


def overview_figure(
    dataset: xr.Dataset, peaks: Peaks, assignment: Assignment | None = None, sweep: int = 0
) -> Figure:
    """Draw a wide sweep on a logarithmic scale, the fitted lines in it, their labels.

    And below how far each lies from its mode.

    Args: dataset of kind `response`; peaks of that sweep; assignment (adds labels and the lower
    panel).
    Returns: the Figure.
    """
    f = dataset["frequency"].values[sweep]
    volts = amplitude(dataset).values[sweep]
    divisor, unit = prefixed(f, "Hz")
    scale, volt = prefixed(np.abs(volts), "V")
    labels = [None] * peaks.frequency.size if assignment is None else list(assignment.best.label)
    with style():
        figure = new_figure(height=3.2 if assignment is None else 4.6)
        ratios = [2.4] if assignment is None else [2.4, 1]
        panels = figure.subplots(len(ratios), 1, sharex=True, squeeze=False, height_ratios=ratios)[
            :, 0
        ]
        upper = panels[0]
        upper.plot(
            f / divisor, np.abs(volts) / scale, color="#9a9a9a", linewidth=0.7, label="measured"
        )
        upper.plot(
            peaks.points / divisor,
            np.abs(peaks.prediction) / scale,
            color=COLOURS[0],
            linewidth=0.9,
            label="fitted",
        )
        size = np.abs(volts[np.isfinite(volts)]) / scale
        height = 2.0 * size.max()
        upper.set_yscale("log")
        upper.set_ylim(
            max(0.7 * size.min(), 1e-5 * size.max()),
            height * (1.2 if assignment is None else 1.2 * (height / size.min()) ** 0.15),
        )
        upper.set_ylabel(axis_label("magnitude |V|", volt))
        places = _spread(
            peaks.frequency / divisor, 0.02 * float(np.nanmax(f) - np.nanmin(f)) / divisor
        )
        tops = np.interp(peaks.frequency, peaks.points, np.abs(peaks.prediction)) / scale
        for frequency, top, place, label in zip(
            peaks.frequency / divisor, tops, places, labels, strict=True
        ):
            colour = INK if label is not None or assignment is None else COLOURS[1]
            upper.plot(
                [frequency, frequency, place],
                [top, 0.75 * height, height],
                color=colour,
                linewidth=0.5,
                linestyle=":",
            )
            text = "" if assignment is None else f"({label.strip('()')})" if label else "?"
            upper.text(
                place,
                height * 1.05,
                as_written(text),
                rotation=90,
                ha="center",
                va="bottom",
                fontsize=7,
                color=colour,
            )
        upper.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
        if assignment is not None:
            sd = (
                np.where(np.isfinite(peaks.frequency_sd), peaks.frequency_sd, 0.0) / peaks.frequency
            )
            _distances(
                panels[1], peaks.frequency / divisor, assignment.deviation, sd, assignment.model_sd
            )
            panel_letters(list(panels))
        panels[-1].set_xlabel(axis_label("drive frequency", unit))
    return figure


def _spread(x: Array, gap: float) -> Array:
    """Places for labels near rising x, at least `gap` apart.

    Neighbours that are too close move aside about their mean.
    """
    blocks: list[list[float]] = []  # sum of (x − offset), count
    for value in x:
        blocks.append([value, 1.0])
        while (
            len(blocks) > 1
            and blocks[-2][0] / blocks[-2][1] + gap * blocks[-2][1] > blocks[-1][0] / blocks[-1][1]
        ):
            total, count = blocks.pop()
            blocks[-1][0] += total - gap * count * blocks[-1][1]
            blocks[-1][1] += count
    starts = [(total / count, int(count)) for total, count in blocks]
    return np.array([start + gap * index for start, count in starts for index in range(count)])


def film_figure(film: FilmFit) -> Figure:
    """Draw how far each line lies from its simulated mode at the common scale.

    Args: film: from `femnl.fits.spectrum.film.fit_film`. Returns: the Figure.
    """
    divisor, unit = prefixed(film.frequency, "Hz")
    with style():
        figure = new_figure(height=2.8)
        axes = figure.subplots()
        _distances(
            axes,
            film.frequency / divisor,
            film.deviation,
            film.frequency_sd / film.frequency,
            film.fit["scatter"],
        )
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + 0.28 * (high - low))
        axes.margins(x=0.05)
        places = _spread(film.frequency / divisor, 0.022 * float(np.ptp(film.frequency)) / divisor)
        for place, label in zip(places, film.label, strict=True):
            axes.text(
                place, high, as_written(label), rotation=90, ha="center", va="bottom", fontsize=7
            )
        axes.set_xlabel(axis_label("frequency", unit))
        axes.set_title("grey: scatter of the simulation", loc="right", fontsize=7.5)
    return figure


def _distances(axes: Axes, x: Array, deviation: Array, sd: Array, scatter: float) -> None:
    """Measured over scaled simulated frequency, less one.

    The grey band is the scatter of the simulation.
    """
    away, share = _share(deviation)
    axes.axhspan(-scatter / share, scatter / share, color="#e8e8e8", zorder=0)
    axes.axhline(0, color=INK, linewidth=0.6)
    axes.errorbar(
        x, deviation / share, sd / share, fmt="o", color=COLOURS[0], ecolor=INK, elinewidth=0.8
    )
    axes.set_ylabel(f"off its mode ({away})")


def _share(values: Array) -> tuple[str, float]:
    """Percent, per mille or parts per million, whichever suits the largest of `values`.

    And its size.
    """
    largest = np.nanmax(np.abs(values)) if np.isfinite(values).any() else 0.0
    return ("%", 1e-2) if largest > 0.02 else ("‰", 1e-3) if largest > 1e-3 else ("ppm", 1e-6)
