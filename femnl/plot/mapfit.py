"""A map fit: what was measured, what the fit predicts, and what it leaves, harmonic by harmonic."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from numpy.typing import NDArray

from femnl.core.comparison import Images
from femnl.io.measurement import amplitude
from femnl.optics.harmonics import along_line, signal_phase
from femnl.plot.comparison import comparison_figure
from femnl.plot.style import (
    DIVERGING,
    WIDTH,
    new_figure,
    prefixed,
    scale_bar,
    style,
    symmetric_limit,
)

_LIMIT = 4.0  # standard deviations at which the colours of the residual end
_ROW = 1.45  # inches


def map_fit_figure(
    dataset: xr.Dataset, prediction: NDArray[np.complex128], residual: NDArray[np.complex128]
) -> Figure:
    """Draw each harmonic's quadrature Re(V_n e^{−iψ_n}) of data and prediction.

    On one scale, with the residual in both quadratures.

    Args: dataset of kind `map`; prediction [V] and residual [standard deviations], both
    (n_harmonics, n_y, n_x), as in `MapFit`.
    Returns: the Figure, a row for each harmonic, a column each for data, prediction, and the
        residual in phase and in quadrature. A single line of points is drawn as curves, with the
        residual in phase.
    """
    volts = amplitude(dataset).values
    harmonics = dataset["harmonic"].values
    x = dataset["x"].values
    y = dataset["y"].values
    if 1 in (x.size, y.size):
        known = np.isfinite(residual)
        noise = np.linalg.norm((volts - prediction)[known]) / np.linalg.norm(residual[known])
        return comparison_figure(
            along_line(
                Images("map", ("the fit",), harmonics, x, y, volts, prediction[None], float(noise))
            )
        )
    with style():
        figure = new_figure(
            WIDTH, _ROW * harmonics.size * min(max(float(np.ptp(y) / np.ptp(x)), 0.5), 1.5) + 0.8
        )
        panels = figure.subplots(harmonics.size, 4, squeeze=False)
        for row, n, measured, fitted, left in zip(
            panels, harmonics, volts, prediction, residual, strict=True
        ):
            turn = np.exp(-1j * signal_phase(measured))
            scale, unit = prefixed(symmetric_limit((measured * turn).real), "V")
            limit = symmetric_limit((measured * turn).real) / scale
            images = [
                (measured * turn).real / scale,
                (fitted * turn).real / scale,
                (left * turn).real,
                (left * turn).imag,
            ]
            for axes, values, top in zip(row, images, (limit, limit, _LIMIT, _LIMIT), strict=True):
                image = _panel(axes, x, y, values, top)
                if axes is row[1] or axes is row[3]:
                    bar = figure.colorbar(
                        image,
                        ax=[row[0], row[1]] if axes is row[1] else [row[2], row[3]],
                        aspect=18,
                        pad=0.02,
                    )
                    bar.set_label(unit if axes is row[1] else "σ")
                    bar.outline.set_linewidth(0.5)
            row[0].set_ylabel(f"{int(n)}f", rotation=0, ha="right", va="center", fontweight="bold")
        for axes, title in zip(
            panels[0], ("measured", "fitted", "residual, in phase", "in quadrature"), strict=True
        ):
            axes.set_title(title)
        scale_bar(panels[-1, 0], float(np.ptp(x)))
    return figure


def _panel(
    axes: Axes,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    values: NDArray[np.float64],
    limit: float,
) -> QuadMesh:
    axes.set_facecolor("#e6e6e6")
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.spines[:].set_visible(False)
    return axes.pcolormesh(
        x, y, values, cmap=DIVERGING, vmin=-limit, vmax=limit, shading="nearest", rasterized=True
    )
