"""A decay with all its phases: power and fit, residual, quality factor against power."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from femnl.core.decay import DecayFit, PhaseName
from femnl.core.numbers import SUPERSCRIPT
from femnl.observe.decay.record import DB
from femnl.plot.style import COLOURS, INK, axis_label, new_figure, panel_letters, prefixed, style

Array = NDArray[np.float64]
SHADES: dict[PhaseName, str] = {
    "before": "#eeeeee",
    "driven": "#fbe3cf",
    "decay": "#d5e8f5",
    "dropout": "#f6d5e4",
    "floor": "#e4e4e4",
    "other try": "#d5efe5",
    "left out": "#f9f3c8",
    "not recorded": "#ffffff",
}
_STEPS = 12  # pieces of the decay whose slopes are drawn
_LEAST = 5  # points of such a piece
_MARGIN = 3.0  # dB above and below the data


def decay_fit_figure(found: DecayFit) -> Figure:
    """Draw the fit of a decay.

    Panels: the power with its phases shaded and the fit; the normal scores of what was fitted; the
    quality factor of short pieces of the decay against their power, or their decay rate where the
    frequency is not known.
    """
    divisor, unit = prefixed(found.time, "s")
    time = found.time / divisor
    with style():
        figure = new_figure(height=5.4)
        grid = figure.add_gridspec(2, 2, height_ratios=[2, 1.2])
        top = figure.add_subplot(grid[0, :])
        left = figure.add_subplot(grid[1, 0])
        right = figure.add_subplot(grid[1, 1])
        _draw_power(top, found, time, divisor)
        top.set(xlabel=axis_label("time", unit), ylabel=axis_label("power", "dB"))
        left.axhline(0, color=INK, linewidth=0.6)
        left.plot(time, found.residual, ".", markersize=2, color=COLOURS[0])
        left.set(xlabel=axis_label("time", unit), ylabel="residual (σ)")
        _draw_quality(right, found)
        panel_letters([top, left, right])
    return figure


def _draw_power(axes: Axes, found: DecayFit, time: Array, divisor: float) -> None:
    """Draw the record over its shaded phases, and the fit with the decay alone."""
    shown: dict[str, Patch] = {}
    for phase in found.phases:
        shade = SHADES[phase.name]
        axes.axvspan(phase.begin / divisor, phase.end / divisor, color=shade, zorder=0, linewidth=0)
        # An outline tells a patch of the legend from the same shade behind it.
        key = Patch(facecolor=shade, edgecolor=INK, linewidth=0.4, label=phase.name)
        shown.setdefault(phase.name, key)
    axes.plot(time, found.power, color="0.55", linewidth=0.6)
    used = np.where(found.used, found.power, np.nan)
    axes.plot(time, used, ".", markersize=2, color=COLOURS[0])
    axes.plot(time, found.mean, color=COLOURS[1], linewidth=1.3)
    axes.set_xlim(time[0], time[-1])
    low = float(np.quantile(found.power, 0.005))
    axes.set_ylim(low - _MARGIN, float(found.power.max()) + _MARGIN)
    axes.legend(handles=list(shown.values()), ncols=4, fontsize=7, loc="upper right")


def _draw_quality(axes: Axes, found: DecayFit) -> None:
    """Draw the quality factor of each piece of the decay against its power."""
    power, rate, sd = local_rates(found)
    quality = found.fit.parameters.get("quality_factor")
    rated = found.fit.parameters["decay_rate"]
    known = rate > 2 * sd
    best = rated if quality is None else quality
    # The power of ten stands in the label; matplotlib would set it on top of the axis.
    unit, exponent = power_of_ten(best.value)
    if quality is None:
        value = rate[known] / unit
    else:
        value = quality.value * rated.value / rate[known] / unit
    error = value * sd[known] / rate[known]
    low = (best.value - best.sd) / unit
    high = (best.value + best.sd) / unit
    axes.axhspan(low, high, color="#fbe3cf", linewidth=0)
    axes.axhline(best.value / unit, color=COLOURS[1])
    axes.errorbar(power[known], value, error, fmt="o", color=COLOURS[0], elinewidth=0.7)
    axes.invert_xaxis()
    name = "quality factor"
    if quality is None:
        name = "decay rate"
        exponent = f"{exponent} 1/s".strip()
    axes.set(xlabel=axis_label("power of the signal", "dB"), ylabel=axis_label(name, exponent))


def power_of_ten(value: float) -> tuple[float, str]:
    """Return the power of ten of a positive value and how it is written: 10⁷ for 1.7·10⁷.

    One, and nothing to write, from 0.01 to 10000: such ticks are short as they are.
    """
    if not 1e-2 <= value < 1e4 and value > 0:
        exponent = int(np.floor(np.log10(value)))
        return 10.0**exponent, f"10{str(exponent).translate(SUPERSCRIPT)}"
    return 1.0, ""


def local_rates(found: DecayFit) -> tuple[Array, Array, Array]:
    """Return mean power [dB], decay rate [1/s] and its sd of short pieces of the decay.

    Pieces have equal numbers of points and lie above the floor; each is a straight line. Beats are
    no damping: where there are any, a piece tells by how much its rate differs from the fitted one.
    """
    floor = found.fit["floor"]
    falling = found.power
    if "partner" in found.fit.parameters:
        falling = found.power - found.mean - DB * found.fit["decay_rate"] * found.time
    strong = np.flatnonzero(found.used & (found.mean > floor + 2 * DB))
    parts = np.array_split(strong, max(min(_STEPS, len(strong) // _LEAST), 1))
    rows = []
    for part in parts:
        if len(part) < 3:
            continue
        time = found.time[part] - found.time[part].mean()
        spread = float(np.sum(time**2))
        slope = float(time @ falling[part]) / spread
        rest = falling[part] - falling[part].mean() - slope * time
        sd = float(np.sqrt(rest @ rest / (len(part) - 2) / spread * found.correlation))
        rows.append((float(found.power[part].mean()), -slope / DB, sd / DB))
    table = np.array(rows).reshape(-1, 3)
    return table[:, 0], table[:, 1], table[:, 2]
