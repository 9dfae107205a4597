"""The harmonics that a readout makes of one motion, as a spectrum."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from femnl.plot.style import COLOURS, INK, WIDTH, as_written, new_figure, style

MARKERS = "osD^v"


def harmonic_spectrum_figure(
    harmonic: ArrayLike, spectra: Mapping[str, ArrayLike], level: float | None = None
) -> Figure:
    """Draw |V_n| relative to the strongest harmonic over n, on a logarithmic scale.

    Args: harmonic: orders n (n_harmonics,). spectra: |V_n| of the same length, by the name in the
    legend. level: a line to compare with.
    """
    with style():
        figure = new_figure(WIDTH, 3.0)
        axes = figure.subplots()
        for k, (name, values) in enumerate(spectra.items()):
            strength = np.abs(np.asarray(values))
            axes.semilogy(
                harmonic,
                strength / strength.max(),
                color=COLOURS[k],
                marker=MARKERS[k % 5],
                label=as_written(name),
            )
        if level is not None:
            axes.axhline(level, color=INK, linewidth=0.8, linestyle="--")
            axes.annotate(
                f"{level * 100:g} %",
                (1.0, level),
                xycoords=("axes fraction", "data"),
                xytext=(-22, 3),
                textcoords="offset points",
                fontsize=8,
            )
        axes.set_xlabel("harmonic n")
        axes.set_ylabel("|Vₙ| / largest")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.legend()
    return figure
