"""One style for all figures: accessible colours, sober axes, units with SI prefixes."""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from femnl.core.errors import one_line

# Okabe and Ito's palette, readable with every common colour blindness (jfly.uni-koeln.de/color).
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#B8A800")
INK = "#333333"
DIVERGING = "RdBu_r"
SEQUENTIAL = "viridis"
LONGEST = 40
"""Signs of a name in a figure."""
WIDTH = 7.2  # inches, two columns of a journal page
_PREFIXES = {-15: "f", -12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}
_TAKES_PREFIX = re.compile(r"(?!kg)[A-Za-zΩ°]+(?![\w^*²³])(?!\*\*)")
_SETTINGS: Any = {
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 9.0,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.prop_cycle": cycler(color=COLOURS),
    "axes.formatter.useoffset": False,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "text.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "lines.linewidth": 1.1,
    "lines.markersize": 3.0,
    "image.interpolation": "nearest",
    "figure.constrained_layout.use": True,
    "figure.dpi": 110.0,
    "savefig.dpi": 200.0,
    "svg.fonttype": "none",
}


@contextmanager
def style() -> Iterator[None]:
    """Draw in femnl's style within this context; settings outside are left alone."""
    with mpl.rc_context(_SETTINGS):
        yield


def new_figure(width: float = WIDTH, height: float = 3.0) -> Figure:
    """A figure of the given size [inch] that belongs to no window and needs no display.

    Call it inside `style()`.
    """
    return Figure(figsize=(width, height), layout="constrained")


def prefixed(values: ArrayLike, unit: str) -> tuple[float, str]:
    """The SI prefix that brings the largest of `values` to 1…1000.

    Returns: the divisor, and the unit with its prefix; (1, unit) where there is no unit, nothing
    finite but zero, or no prefix would be right: of kg, m^2 or 1/V.
    """
    numbers = np.abs(np.asarray(values, dtype=float))
    numbers = numbers[np.isfinite(numbers) & (numbers > 0)]
    if not _TAKES_PREFIX.match(unit) or numbers.size == 0:
        return 1.0, unit
    # The tiny excess keeps 999.9999 from being labelled 1e3 of the smaller unit.
    exponent = int(np.clip(3 * np.floor(np.log10(numbers.max() * (1 + 1e-9)) / 3), -15, 12))
    return 10.0**exponent, _PREFIXES[exponent] + unit


def axis_label(quantity: str, unit: str) -> str:
    """Write quantity (unit), or the quantity alone where it has no unit."""
    return f"{quantity} ({unit})" if unit else quantity


def as_written(text: str) -> str:
    """Return a file's text for a figure, where $ is no mathematics and a long one is cut."""
    shown = one_line(text)
    short = shown if len(shown) <= LONGEST else f"{shown[:LONGEST]}…"
    return short.replace("$", r"\$")


def panel_letters(axes: Sequence[Axes]) -> None:
    """Write a, b, c … in bold at the upper left of each panel."""
    for letter, panel in zip("abcdefghijklmnopqrstuvwxyz", axes, strict=False):
        panel.set_title(letter, loc="left", fontweight="bold")


def scale_bar(axes: Axes, width: float, unit: str = "m", colour: str = INK) -> None:
    """Draw a bar of a round length near a quarter of `width` below the lower left corner of a map.

    Args: axes: in units of `unit`·1 (m); width: extent of the map [m].
    """
    exact = width / 4
    base = 10.0 ** np.floor(np.log10(exact))
    length = float(base * max(step for step in (1, 2, 5) if step * base <= exact * 1.0001))
    divisor, name = prefixed(length, unit)
    left, right = axes.get_xlim()
    bottom, top = sorted(axes.get_ylim())
    y = bottom - 0.06 * (top - bottom)
    axes.plot(
        [left, left + length],
        [y, y],
        color=colour,
        linewidth=2.2,
        solid_capstyle="butt",
        clip_on=False,
    )
    axes.text(
        left + length + 0.02 * (right - left),
        y,
        f"{length / divisor:g} {name}",
        ha="left",
        va="center",
        fontsize=8,
        color=colour,
        clip_on=False,
    )
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)


def symmetric_limit(values: ArrayLike, quantile: float = 0.999) -> float:
    """A colour limit for a map centred on zero.

    The given quantile of |values|, so that single outliers do not wash it out.
    """
    magnitude: NDArray[np.float64] = np.abs(np.asarray(values, dtype=float))
    magnitude = magnitude[np.isfinite(magnitude)]
    limit = float(np.quantile(magnitude, quantile)) if magnitude.size else 0.0
    return limit if limit > 0 else 1.0
