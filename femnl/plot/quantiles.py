"""Whether residuals are normal: sorted, against the quantiles of the normal distribution."""

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.special import betaincinv, ndtri

from femnl.core.readout import Array
from femnl.plot.style import COLOURS, INK, new_figure, style

MOST = 2000
"""Points that are drawn; of more data those at evenly spaced ranks, and all in the tails."""
TAIL = 200
SIDES = (0.025, 0.975)
"""Of each order statistic: 95 % lie between."""


def quantiles_figure(residuals: Array) -> Figure:
    """Draw a normal quantile plot.

    The k-th of n residuals stands at the median of where the k-th of n normal numbers lies; the
    band holds 95 % of these, one by one. uₖ of uniform numbers follows Beta(k, n + 1 − k).

    Args: residuals (n,) [σ], independent of each other where the model holds.
    Returns: the Figure.
    """
    n = residuals.size
    rank = _shown(n)
    middle, low, high = (ndtri(betaincinv(rank, n + 1 - rank, part)) for part in (0.5, *SIDES))
    with style():
        figure = new_figure(4.8, 4.0)
        axes = figure.subplots()
        axes.fill_between(middle, low, high, color="#e0e0e0", linewidth=0, label="95 % if normal")
        axes.plot(middle, middle, color=INK, linewidth=0.7)
        axes.plot(middle, np.sort(residuals)[rank - 1], ".", color=COLOURS[0], label="residuals")
        axes.set_xlabel("normal quantile (σ)")
        axes.set_ylabel("residual (σ)")
        axes.legend(loc="upper left")
    return figure


def _shown(n: int) -> NDArray[np.int64]:
    """Return the ranks, from 1, that are drawn."""
    ranks = np.arange(1, n + 1)
    if n <= MOST:
        return ranks
    inner = np.linspace(TAIL, n - TAIL, MOST - 2 * TAIL).round().astype(int)
    return np.unique(np.concatenate([ranks[:TAIL], inner, ranks[-TAIL:]]))
