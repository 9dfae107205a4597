"""Driven responses: magnitude and phase against frequency, sweep by sweep."""

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from femnl.core.choices import Use
from femnl.core.errors import MeasurementError
from femnl.io.measurement import amplitude, noise_sd
from femnl.plot.style import (
    COLOURS,
    INK,
    SEQUENTIAL,
    axis_label,
    new_figure,
    panel_letters,
    prefixed,
    style,
)

_NARROW = 0.02  # relative width below which frequencies are written as distance from the middle
_DYNAMIC = 25.0  # largest over median magnitude above which the magnitude is drawn logarithmically
_LEGEND = 6
_SEEN = 3.0  # the phase of weaker amplitudes, in units of the noise, says nothing and is not drawn
_FEW = 40


def _noise(dataset: xr.Dataset) -> float:
    """Return the noise [V] that phases are drawn above; 0, for all of them, where none shows."""
    try:
        return noise_sd(dataset)[0]
    except MeasurementError:
        return 0.0


def response_figure(
    dataset: xr.Dataset, fitted: xr.DataArray | None = None, use: Use = "complex"
) -> Figure:
    """Draw a `response`: |V| and its phase against the drive frequency.

    Colours tell the drive where it varies, else the position, else the order of sweeps; sweeps down
    are dashed. With a fit the data are points and the lines are its.
    Args: dataset of kind `response`; fitted (sweep, point) complex [V]; use: what was fitted, which
    is all that is drawn of the fit.
    Returns: the Figure, magnitude above phase where that is known, and with a fit what it leaves.
    """
    frequency = dataset["frequency"].values
    volts = amplitude(dataset).values
    middle = 0.5 * (np.nanmin(frequency) + np.nanmax(frequency))
    narrow = np.nanmax(frequency) - np.nanmin(frequency) < _NARROW * middle
    shift = middle if narrow else 0.0
    divisor, unit = prefixed(frequency - shift, "Hz")
    scale, volt_unit = prefixed(np.abs(volts), "V")
    noise = _noise(dataset) if np.count_nonzero(np.isfinite(volts)) > _FEW else 0.0
    names, key, numbers = _key(dataset)
    phases = "magnitude" not in dataset
    half = 90 if use == "phase-mod-pi" else 180
    with style():
        ratios = [1.6, *([1.0] if phases else []), *([] if fitted is None else [0.9])]
        result = new_figure(height=2.0 + 1.2 * len(ratios))
        panels = result.subplots(
            len(ratios), 1, sharex=True, squeeze=False, height_ratios=ratios
        ).ravel()
        magnitude = panels[0]
        phase = panels[1] if phases else None
        norm = _norm(numbers)
        order = {number: rank for rank, number in enumerate(np.unique(numbers))}
        down = (
            dataset["direction"].values < 0
            if "direction" in dataset.coords
            else np.zeros(len(names), dtype=bool)
        )
        for index, name in enumerate(names):
            colour = (
                COLOURS[order[numbers[index]]]
                if norm is None
                else mpl.colormaps[SEQUENTIAL](0.92 * norm(numbers[index]))
            )
            dashes = {
                "color": colour,
                "linestyle": (0, (4, 1.5)) if down[index] else "-",
                "label": name,
            }
            x = (frequency[index] - shift) / divisor
            seen = np.where(
                np.abs(volts[index]) > _SEEN * noise, _degrees(volts[index], use), np.nan
            )
            if fitted is None:
                magnitude.plot(x, np.abs(volts[index]) / scale, **dashes)
                if phase is not None:
                    _plot_phase(phase, x, seen, dashes, half)
                continue
            points = {
                "color": colour,
                "linestyle": "none",
                "marker": "o",
                "markersize": 2.0,
                "alpha": 0.45,
                "markeredgewidth": 0.0,
            }
            magnitude.plot(x, np.abs(volts[index]) / scale, **points)
            if phase is not None:
                phase.plot(x, seen, **points)
            model = fitted.values[index]
            left = _residual(volts[index], model, use) / (noise or scale)
            panels[-1].plot(x, left, **{**points, "alpha": 0.7})
            if use in ("complex", "magnitude"):
                magnitude.plot(x, np.abs(model) / scale, **dashes)
            if phase is not None and use != "magnitude":
                _plot_phase(phase, x, _degrees(model, use), dashes, half)
        top = np.nanmax(np.abs(volts))
        if top > _DYNAMIC * np.nanmedian(np.abs(volts)):
            magnitude.set_yscale("log")
            size = np.abs(volts)
            magnitude.set_ylim(bottom=0.5 * np.nanquantile(size[size > 0], 0.02) / scale)
        else:
            magnitude.set_ylim(bottom=0)
        magnitude.set_ylabel(axis_label("magnitude |V|", volt_unit))
        if phase is not None:
            phase.set_ylabel("phase modulo π (°)" if half == 90 else "phase (°)")
            phase.set_yticks([-half, -half / 2, 0, half / 2, half])
            phase.set_ylim(-1.05 * half, 1.05 * half)
            phase.grid(axis="y", color="#dddddd", linewidth=0.6)
        centre, centre_unit = prefixed(middle, "Hz")
        if fitted is not None:
            _scale_residuals(panels[-1])
            panels[-1].axhline(0, color=INK, linewidth=0.6)
            panels[-1].set_ylabel("residual (σ)" if noise else axis_label("residual", volt_unit))
        panels[-1].set_xlabel(
            axis_label(
                f"drive frequency − {middle / centre:.9g} {centre_unit}"
                if narrow
                else "drive frequency",
                unit,
            )
        )
        panel_letters(list(panels))
        _explain(result, list(panels[: 1 + phases]), names, key, norm, down)
        if fitted is not None:
            magnitude.set_title("points: measured   lines: fitted", loc="right", fontsize=7.5)
    return result


def _residual(
    volts: NDArray[np.complex128], model: NDArray[np.complex128], use: Use
) -> NDArray[np.float64]:
    """Return what a fit leaves [V], a column each: both quadratures, or what was fitted."""
    if use == "complex":
        left = volts - model
        return np.stack([left.real, left.imag], axis=1)
    if use == "magnitude":
        return np.asarray(np.abs(volts) - np.abs(model))[:, None]
    turn = 2 if use == "phase-mod-pi" else 1
    return np.asarray(np.abs(volts) * np.angle((volts * model.conj()) ** turn) / turn)[:, None]


def _scale_residuals(axes: Axes) -> None:
    """Draw residuals logarithmically beyond their median where a few are far larger than it.

    A point within a jump, between two states, would else press all others onto zero.
    """
    drawn = np.concatenate([np.ravel(np.asarray(one.get_ydata(), float)) for one in axes.lines])
    size = np.abs(drawn[np.isfinite(drawn) & (drawn != 0)])
    if size.size and size.max() > _DYNAMIC * np.median(size):
        decade = 10 ** np.floor(np.log10(np.median(size)))
        axes.set_yscale("symlog", linthresh=decade)
        # One tick a decade on either side is more than the panel holds
        far = 10 ** np.floor(np.log10(size.max()))
        axes.set_yticks([-far, -decade, 0, decade, far])
        axes.set_ylim(-2 * size.max(), 2 * size.max())


def _degrees(volts: NDArray[np.complex128], use: Use) -> NDArray[np.float64]:
    """The phase in degrees, in (−90°, 90°] where only its value modulo π counts."""
    turn = 2 if use == "phase-mod-pi" else 1
    return np.asarray(np.degrees(np.angle(volts**turn)) / turn)


def _plot_phase(
    axes: Axes,
    x: NDArray[np.float64],
    degrees: NDArray[np.float64],
    test: dict[str, Any],
    half: float,
) -> None:
    """Draw the phase in (−half, half], the line broken where it wraps."""
    jumps = np.flatnonzero(np.abs(np.diff(degrees)) > half) + 1
    axes.plot(np.insert(x, jumps, np.nan), np.insert(degrees, jumps, np.nan), **test)


def _key(dataset: xr.Dataset) -> tuple[list[str], str, NDArray[np.float64]]:
    """What tells the sweeps apart: their names, the quantity with its unit, and its values."""
    sweeps = dataset.sizes["sweep"]
    for quantity, unit in (("drive", "V"), ("x", "m"), ("y", "m"), ("harmonic", "")):
        if (
            quantity in dataset.coords
            and np.unique(dataset[quantity].values[np.isfinite(dataset[quantity].values)]).size > 1
        ):
            values = dataset[quantity].values.astype(float)
            divisor, name = prefixed(values, unit)
            return (
                [f"{value / divisor:.4g} {name}".strip() for value in values],
                axis_label(quantity, name),
                values / divisor,
            )
    return [f"sweep {index + 1}" for index in range(sweeps)], "sweep", np.arange(1.0, sweeps + 1)


def _norm(numbers: NDArray[np.float64]) -> Normalize | None:
    """Colour scale where there are more sweeps than a legend holds.

    Logarithmic over more than a decade.
    """
    low = np.nanmin(numbers)
    high = np.nanmax(numbers)
    if np.unique(numbers).size <= _LEGEND or not low < high:
        return None
    return LogNorm(low, high) if low > 0 and high > 8 * low else Normalize(low, high)


def _explain(
    result: Figure,
    panels: Sequence[Axes],
    names: list[str],
    key: str,
    norm: Normalize | None,
    down: NDArray[np.bool_],
) -> None:
    """Legend or colour bar for the sweeps, and a line that tells the directions apart."""
    if norm is not None:
        levels = mpl.colors.ListedColormap(mpl.colormaps[SEQUENTIAL](0.92 * np.linspace(0, 1, 256)))
        bar = result.colorbar(ScalarMappable(norm, levels), ax=panels, aspect=40, pad=0.01)
        bar.set_label(key)
        bar.outline.set_linewidth(0.5)
    elif len(set(names)) > 1:
        lines = {
            str(line.get_label()): line
            for panel in panels
            for line in panel.lines
            if line.get_label() in names
        }
        panels[0].legend(
            [Line2D([], [], color=line.get_color()) for line in lines.values()],
            list(lines),
            title=key.split(" (")[0],
            loc="best",
        )
    if down.any() and not down.all():
        panels[1].text(
            1.0,
            1.02,
            "solid: up   dashed: down",
            transform=panels[1].transAxes,
            ha="right",
            va="bottom",
            fontsize=7.5,
            color=INK,
        )
