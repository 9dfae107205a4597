"""A line over the membrane: what the place changes in a response, and what it does not."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import NDArray

from femnl.plot.style import COLOURS, INK, axis_label, new_figure, panel_letters, prefixed, style


def line_scan_figure(scan: xr.Dataset) -> Figure:
    """Draw α_y and α_y/α_c against the place along a line.

    As figure 2 (e), (f) of arXiv:2502.19191.

    Args: scan: from `femnl.fits.response.linescan.fit_line_scan`. Returns: the Figure; the upper
    panel is left out where α_y was not seen.
    """
    place, name = _along(scan)
    divisor, unit = prefixed(place, "m")
    drawn = [key for key in ("alpha_y", "alpha_ratio") if key in scan]
    with style():
        figure = new_figure(height=0.9 + 1.7 * len(drawn))
        panels = figure.subplots(len(drawn), 1, sharex=True, squeeze=False).ravel()
        for colour, axes, key in zip(COLOURS, panels, drawn, strict=False):
            value = scan[key].values
            sd = scan[f"{key}_sd"].values
            axes.errorbar(
                place / divisor, value, sd, fmt="o", color=colour, ecolor=INK, elinewidth=0.8
            )
            if key == "alpha_y":
                axes.set_yscale("log" if np.all(value > 0) else "linear")
                axes.set_ylabel(r"$\alpha_y$ (V$^{-2}$)")
        mean = float(scan.attrs["alpha_ratio"])
        error = float(scan.attrs["alpha_ratio_sd"])
        last = panels[-1]
        last.axhspan(mean - error, mean + error, color="#cccccc", zorder=0)
        last.axhline(mean, color=INK, linewidth=0.7)
        last.set_ylabel(r"$\alpha_y/\alpha_c$")
        scatter = float(scan.attrs["scatter"])
        last.set_title(
            f"mean {mean:.5g} ± {error:.1g}, scatter of the places χ²/ν = {scatter:.2f}",
            loc="right",
            fontsize=7.5,
        )
        last.set_xlabel(axis_label(name, unit))
        panel_letters(list(panels))
    return figure


def _along(scan: xr.Dataset) -> tuple[NDArray[np.float64], str]:
    """The coordinate along the line [m] and its name.

    x or y where only that changes, else the distance from the first place.
    """
    x = scan["x"].values
    y = scan["y"].values
    if np.ptp(y) == 0:
        return x, "x"
    return (y, "y") if np.ptp(x) == 0 else (np.hypot(x - x[0], y - y[0]), "distance")
