"""Sampled signals: in time, in frequency, and against the step of the drive."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from femnl.plot.style import (
    COLOURS,
    DIVERGING,
    SEQUENTIAL,
    axis_label,
    new_figure,
    panel_letters,
    prefixed,
    style,
    symmetric_limit,
)

# More points than this in one line are drawn as the band between smallest and largest
_COLUMNS = 1500
_WAVES = 3
FAINT = 1e-30
"""Amplitude [V] below all that a file may hold."""
_PERIODS = 4.0  # of the drive, shown of each wave


def trace_figure(dataset: xr.Dataset) -> Figure:
    """Draw a `trace`: one step as signal (with its drive) and spectrum.

    Several as waves, over time and over frequency.

    Args: dataset of kind `trace`. Returns: the Figure.
    """
    with style():
        return _one_step(dataset) if dataset.sizes["step"] == 1 else _many_steps(dataset)


def _one_step(dataset: xr.Dataset) -> Figure:
    signals = [key for key in ("voltage", "drive_voltage") if key in dataset]
    result = new_figure(height=1.6 * len(signals) + 2.2)
    panels = result.subplots(len(signals) + 1, 1, height_ratios=(*[1.0] * len(signals), 1.3))
    divisor, unit = prefixed(dataset["time"].values, "s")
    spectrum = panels[-1]
    for colour, axes, key in zip(COLOURS, panels, signals, strict=False):
        values = dataset[key].values[0]
        scale, volt = prefixed(values, "V")
        _line(axes, dataset["time"].values / divisor, values / scale, colour)
        axes.set_ylabel(axis_label(key.replace("_", " "), volt))
        axes.set_xlabel(axis_label("time", unit))
        axes.margins(x=0.01)
    for axes, neighbour in zip(panels[1:-1], panels[:-2], strict=True):
        axes.sharex(neighbour)
        neighbour.set_xlabel("")
        neighbour.tick_params(labelbottom=False)
    for colour, key in reversed(list(zip(COLOURS, signals, strict=False))):
        frequency, volts = _spectrum(dataset["time"].values, dataset[key].values)
        hertz, name = prefixed(frequency, "Hz")
        _line(spectrum, frequency / hertz, volts[0], colour, key.replace("_", " "))
        spectrum.set_xlabel(axis_label("frequency", name))
    spectrum.set_yscale("log")
    spectrum.set_ylabel("amplitude (V)")
    spectrum.margins(x=0.01)
    if len(signals) > 1:
        spectrum.legend(loc="upper right")
    panel_letters(list(panels))
    return result


def _many_steps(dataset: xr.Dataset) -> Figure:
    time = dataset["time"].values
    voltage = dataset["voltage"].values
    divisor, unit = prefixed(time, "s")
    scale, volt = prefixed(voltage, "V")
    # Steps of which some have no frequency are counted
    has_drive = "drive_frequency" in dataset.coords and bool(
        np.isfinite(dataset["drive_frequency"].values).all()
    )
    steps = dataset["drive_frequency"].values if has_drive else np.arange(1.0, voltage.shape[0] + 1)
    step_scale, step_unit = prefixed(steps, "Hz") if has_drive else (1.0, "")
    step_label = axis_label("drive frequency" if has_drive else "step", step_unit)
    result = new_figure(height=5.6)
    grid = result.add_gridspec(2, 2, height_ratios=(1, 1.5))
    waves = result.add_subplot(grid[0, :])
    picture = result.add_subplot(grid[1, 0])
    spectra = result.add_subplot(grid[1, 1])
    shown = time - time[0] <= (_PERIODS / np.nanmin(steps) if has_drive else np.inf)
    for colour, index in zip(
        COLOURS, np.unique(np.linspace(0, len(steps) - 1, _WAVES).round().astype(int)), strict=False
    ):
        _line(
            waves,
            time[shown] / divisor,
            voltage[index, shown] / scale,
            colour,
            f"{steps[index] / step_scale:.6g} {step_unit}".strip(),
        )
    waves.legend(loc="upper right", ncols=_WAVES)
    waves.margins(x=0.01)
    waves.set_ylim(top=waves.get_ylim()[1] + 0.25 * np.ptp(waves.get_ylim()))
    waves.set_xlabel(axis_label("time", unit))
    waves.set_ylabel(axis_label("voltage", volt))
    order = np.argsort(steps, kind="stable")
    limit = symmetric_limit(voltage) / scale
    x = time / divisor
    rows = steps[order] / step_scale
    image = picture.pcolormesh(
        x,
        rows,
        voltage[order] / scale,
        cmap=DIVERGING,
        vmin=-limit,
        vmax=limit,
        shading="nearest",
        rasterized=True,
    )
    picture.set_xlabel(axis_label("time", unit))
    picture.set_ylabel(step_label)
    result.colorbar(image, ax=picture, label=axis_label("voltage", volt), aspect=30, pad=0.02)
    frequency, volts = _spectrum(time, voltage)
    hertz, name = prefixed(frequency, "Hz")
    decades = np.log10(np.maximum(volts[order], np.nanmax(volts) * 1e-6))
    image = spectra.pcolormesh(
        frequency / hertz,
        rows,
        decades,
        cmap=SEQUENTIAL,
        vmin=np.nanquantile(decades, 0.2),
        shading="nearest",
        rasterized=True,
    )
    spectra.set_xlabel(axis_label("frequency", name))
    spectra.tick_params(labelleft=False)
    result.colorbar(image, ax=spectra, label="log₁₀ amplitude (V)", aspect=30, pad=0.02)
    panel_letters([waves, picture, spectra])
    return result


def _line(
    axes: Axes,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    colour: str,
    label: str | None = None,
) -> None:
    """Draw y(x); a long one as the band between extremes, so that no spike is lost."""
    if x.size <= 2 * _COLUMNS:
        axes.plot(x, y, color=colour, label=label, linewidth=0.9)
        return
    edges = np.linspace(0, x.size, _COLUMNS + 1).astype(int)[:-1]
    axes.fill_between(
        x[edges],
        np.fmin.reduceat(y, edges),
        np.fmax.reduceat(y, edges),
        color=colour,
        alpha=0.8,
        label=label,
        linewidth=0.4,
    )


def _spectrum(
    time: NDArray[np.float64], voltage: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies [Hz] and amplitudes [V] (step, frequency) of the Hann-windowed signals.

    Missing samples stand at the mean. No amplitude is below FAINT, which a log scale can show.
    """
    window = np.hanning(time.size + 1)[:-1]
    swing = np.nan_to_num(voltage - np.nanmean(voltage, axis=1, keepdims=True))
    volts = 2 * np.abs(np.fft.rfft(swing * window, axis=1)) / window.sum()
    frequency: NDArray[np.float64] = np.asarray(
        np.fft.rfftfreq(time.size, float(np.median(np.diff(time)))), dtype=np.float64
    )
    return frequency[1:], np.maximum(volts[:, 1:], FAINT)
