"""Harmonic maps: one panel a harmonic, in the quadrature that holds the signal."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator
from numpy.typing import ArrayLike, NDArray

from femnl.io.measurement import amplitude
from femnl.optics.harmonics import signal_phase
from femnl.plot.style import (
    DIVERGING,
    INK,
    WIDTH,
    axis_label,
    new_figure,
    prefixed,
    scale_bar,
    style,
    symmetric_limit,
)


def harmonic_map_figure(
    dataset: xr.Dataset, outline: ArrayLike | None = None, title: str | None = None
) -> Figure:
    """Draw a measurement of kind `map`.

    Per harmonic n the real quadrature Re(V_n e^{−iψ_n}), colours centred on zero.

    Args: dataset of kind `map` (x, y in m, amplitudes in V); outline: closed polyline (n, 2) of the
    membrane [m]; title.
    Returns: the Figure; each panel names n, its phase ψ_n, and has a colour bar of its own, as
        harmonics differ by orders of magnitude. A single line of points is drawn as curves.
    """
    volts = amplitude(dataset).values
    harmonics = dataset["harmonic"].values
    columns = min(3, harmonics.size)
    rows = -(-harmonics.size // columns)
    x = dataset["x"].values
    y = dataset["y"].values
    if 1 in (x.size, y.size):
        return _line_figure(volts, harmonics, *((x, "x") if y.size == 1 else (y, "y")), title)
    line = None if outline is None else np.asarray(outline, dtype=float)
    box = _box(x, y, line)
    panel = WIDTH / 3 if columns == 3 else WIDTH / 2.4
    aspect = (box[3] - box[2]) / (box[1] - box[0])
    with style():
        figure = new_figure(
            panel * columns, rows * (0.74 * panel * min(max(aspect, 0.35), 2.0) + 0.32) + 0.35
        )
        panels = figure.subplots(rows, columns, squeeze=False).ravel()
        for axes, n, values in zip(panels, harmonics, volts, strict=False):
            _panel(axes, int(n), values, x=x, y=y, line=line, box=box)
        for axes in panels[harmonics.size :]:
            axes.set_axis_off()
        scale_bar(panels[0], box[1] - box[0])
        if title:
            figure.suptitle(title, fontsize=10)
    return figure


def _line_figure(
    volts: NDArray[np.complex128],
    harmonics: NDArray[np.int64],
    along: NDArray[np.float64],
    name: str,
    title: str | None,
) -> Figure:
    """The quadratures that hold the signals along a line: a panel each."""
    columns = min(3, harmonics.size)
    rows = -(-harmonics.size // columns)
    step, length = prefixed(along, "m")
    with style():
        figure = new_figure(WIDTH / 3 * columns, 1.7 * rows + 0.3)
        panels = figure.subplots(rows, columns, squeeze=False, sharex=True)
        for axes, n, values in zip(panels.ravel(), harmonics, volts, strict=False):
            phase = signal_phase(values)
            signal = (values * np.exp(-1j * phase)).real.ravel()
            divisor, unit = prefixed(signal, "V")
            axes.plot(along / step, signal / divisor, ".-", markersize=3, linewidth=0.7)
            axes.set_title(f"{n}f   {round(np.degrees(phase))}°".replace("-", "−"), fontsize=9)
            axes.set_ylabel(axis_label("signal", unit))
        for axes in panels.ravel()[harmonics.size :]:
            axes.set_axis_off()
        figure.supxlabel(axis_label(name, length), fontsize=9)
        if title:
            figure.suptitle(title, fontsize=10)
    return figure


def _box(
    x: NDArray[np.float64], y: NDArray[np.float64], line: NDArray[np.float64] | None
) -> tuple[float, float, float, float]:
    """Left, right, bottom and top [m] of what a panel shows: the pixels and the outline."""
    half_x = _half_step(x)
    half_y = _half_step(y)
    box = [x[0] - half_x, x[-1] + half_x, y[0] - half_y, y[-1] + half_y]
    if line is not None:
        margin = 0.02 * float(np.ptp(line[:, 0]))
        low = np.min(line, axis=0) - margin
        high = np.max(line, axis=0) + margin
        box = [min(box[0], low[0]), max(box[1], high[0]), min(box[2], low[1]), max(box[3], high[1])]
    return float(box[0]), float(box[1]), float(box[2]), float(box[3])


def _half_step(axis: NDArray[np.float64]) -> float:
    return float(np.median(np.diff(axis)) / 2) if axis.size > 1 else 0.5e-6


def _panel(
    axes: Axes,
    n: int,
    volts: NDArray[np.complex128],
    *,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    line: NDArray[np.float64] | None,
    box: tuple[float, float, float, float],
) -> None:
    phase = signal_phase(volts)
    values = (volts * np.exp(-1j * phase)).real
    divisor, unit = prefixed(symmetric_limit(values), "V")
    limit = symmetric_limit(values) / divisor
    axes.set_facecolor("#e6e6e6")
    image = axes.pcolormesh(
        x,
        y,
        values / divisor,
        cmap=DIVERGING,
        vmin=-limit,
        vmax=limit,
        shading="nearest",
        rasterized=True,
    )
    if line is not None:
        closed = np.vstack([line, line[:1]])
        axes.plot(closed[:, 0], closed[:, 1], color=INK, linewidth=0.8)
    axes.set_xlim(box[0], box[1])
    axes.set_ylim(box[2], box[3])
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.spines[:].set_visible(False)
    axes.set_title(f"{n}f   {round(np.degrees(phase))}°".replace("-", "−"), fontsize=9)
    bar = axes.figure.colorbar(image, ax=axes, shrink=0.86, aspect=22, pad=0.02)
    bar.set_label(unit, labelpad=2)
    bar.outline.set_linewidth(0.5)
    bar.locator = _three_ticks(limit)
    bar.update_ticks()


def _three_ticks(limit: float) -> FixedLocator:
    base = 10.0 ** np.floor(np.log10(limit))
    step = max(s for s in (1, 2, 5) if s * base <= limit * 1.0001) * base
    return FixedLocator([-step, 0.0, step])
