"""A series with the law that was fitted to it, and the residuals."""

import numpy as np
from matplotlib.figure import Figure

from femnl.fits.series.law import SeriesFit
from femnl.plot.style import COLOURS, INK, axis_label, new_figure, panel_letters, style


def series_fit_figure(found: SeriesFit) -> Figure:
    """Draw the points with their errors and the law above, and below what is left in σ.

    Args: found: from `fit_series`. Returns: the Figure.
    """
    order = np.argsort(found.x)
    logarithmic = found.law == "power"
    with style():
        figure = new_figure(height=3.6)
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        upper.errorbar(
            found.x, found.y, found.sd, fmt="o", color=COLOURS[0], ecolor=INK, elinewidth=0.8
        )
        upper.plot(found.x[order], found.line[order], color=COLOURS[1], linewidth=0.9)
        if logarithmic:
            upper.set_xscale("log")
            upper.set_yscale("log")
        unit = "Hz" if found.quantity == "frequency" else ""
        upper.set_ylabel(axis_label(found.quantity.replace("_", " "), unit))
        lower.axhline(0, color=INK, linewidth=0.6)
        lower.plot(found.x, (found.y - found.line) / found.sd, "o", color=COLOURS[0])
        lower.set_ylabel("residual (σ)")
        lower.set_xlabel(axis_label(found.control.replace("_", " "), found.unit))
        panel_letters([upper, lower])
    return figure
