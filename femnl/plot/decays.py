"""Motions in time: free decays with their fit, and residuals of oscillator models."""

from collections.abc import Mapping

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import uniform_filter1d

from femnl.core.fit import Fit
from femnl.fits.decay.model import blocks
from femnl.fits.decay.ringdown import predict_ringdown
from femnl.plot.style import COLOURS, INK, axis_label, new_figure, panel_letters, prefixed, style

_STRONG = 10.0  # noise of a block, below which its frequency says nothing
_RUNNING = 400  # samples of the running mean of errors
_THIN = 4000  # points of a magnitude that are drawn


def ringdown_figure(time: ArrayLike, signal: ArrayLike, fit: Fit) -> Figure:
    """Draw a free decay: amplitude on a logarithmic scale, and shift of the frequency.

    The shift is from that of small motion.

    Args: time (n,) [s]; signal (n,) [V], the voltage or, for a fit of magnitudes, the magnitude;
    fit: from `fit_ringdown`.
    Returns: the Figure; one panel for a magnitude, which has no phase.
    """
    t = np.asarray(time, dtype=float) - np.asarray(time, dtype=float)[0]
    volts = np.asarray(signal, dtype=float)
    whole = "frequency" in fit.parameters
    if whole:
        places, amplitude = blocks(t, np.where(np.isfinite(volts), volts, 0.0), fit["frequency"])
        size = np.abs(amplitude)
    else:
        kept = np.flatnonzero(np.isfinite(volts))[:: max(1, t.size // _THIN)]
        places = t[kept]
        size = volts[kept]
    model = np.sqrt(
        np.abs(predict_ringdown(fit, places)) ** 2 + (0.0 if whole else max(fit["floor"], 0.0))
    )
    divisor, unit = prefixed(t, "s")
    scale, volt = prefixed(size, "V")
    with style():
        figure = new_figure(height=4.2 if whole else 2.8)
        panels = figure.subplots(
            2 if whole else 1,
            1,
            sharex=True,
            squeeze=False,
            height_ratios=[1.5, 1] if whole else [1],
        ).ravel()
        panels[0].semilogy(
            places / divisor,
            size / scale,
            "o",
            color=COLOURS[0],
            markersize=2,
            alpha=0.5,
            label="measured",
        )
        panels[0].semilogy(places / divisor, model / scale, color=INK, label="fitted")
        panels[0].set_ylim(
            bottom=0.5 * max(float(np.min(model)), float(np.quantile(size, 0.02))) / scale
        )
        panels[0].set_ylabel(axis_label("amplitude |A|", volt))
        panels[0].legend()
        if whole:
            noise = float(np.median(np.abs(np.diff(size - model)))) + 1e-300
            strong = (size[1:] > _STRONG * noise) & (model[1:] > _STRONG * noise)
            middle = 0.5 * (places[1:] + places[:-1])[strong]
            measured = _rate(amplitude, places)[strong]
            expected = _rate(
                predict_ringdown(fit, places) * np.exp(-2j * np.pi * fit["frequency"] * places),
                places,
            )[strong]
            shift, hertz = prefixed(np.concatenate([measured, expected]), "Hz")
            panels[1].plot(
                middle / divisor, measured / shift, "o", color=COLOURS[0], markersize=2, alpha=0.5
            )
            panels[1].plot(middle / divisor, expected / shift, color=INK)
            tone, name = prefixed(fit["frequency"], "Hz")
            panels[1].set_ylabel(axis_label("f(t) − f", hertz))
            panels[1].set_title(
                f"f = {fit['frequency'] / tone:.9g} {name}", loc="right", fontsize=7.5
            )
            panel_letters(list(panels))
        panels[-1].set_xlabel(axis_label("time", unit))
    return figure


def _rate(amplitude: NDArray[np.complex128], time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Frequency [Hz] between neighbouring points of a complex amplitude."""
    return np.asarray(
        np.angle(amplitude[1:] * np.conj(amplitude[:-1])) / (2 * np.pi * np.diff(time))
    )


def oscillator_figure(
    dataset: xr.Dataset, errors: Mapping[str, NDArray[np.float64]], held_out: slice | None = None
) -> Figure:
    """Draw the output of a driven oscillator and the running rms error of models.

    Args: dataset of kind `trace`, one step; errors: by the name of the model, (n,) [V]; held_out:
    samples that were not fitted, shaded.
    Returns: the Figure.
    """
    time = dataset["time"].values
    divisor, unit = prefixed(time, "s")
    scale, volt = prefixed(dataset["voltage"].values, "V")
    step = max(1, time.size // 20_000)
    with style():
        figure = new_figure(height=4.2)
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=[1, 2])
        top.plot(
            time[::step] / divisor, dataset["voltage"].values[0, ::step] / scale, linewidth=0.3
        )
        top.set_ylabel(axis_label("output", volt))
        small, millivolt = prefixed(
            np.concatenate([error[np.isfinite(error)] for error in errors.values()]), "V"
        )
        for colour, (name, error) in zip(COLOURS, errors.items(), strict=False):
            running = np.sqrt(uniform_filter1d(np.nan_to_num(error) ** 2, _RUNNING))[::step]
            bottom.plot(
                time[::step] / divisor,
                np.where(running > 0, running, np.nan) / small,
                color=colour,
                label=name,
                linewidth=0.9,
            )
        bottom.set(
            yscale="log",
            ylabel=axis_label("running rms error", millivolt),
            xlabel=axis_label("time", unit),
        )
        bottom.set_xlim(time[0] / divisor, time[-1] / divisor)
        if held_out is not None:
            for axes in (top, bottom):
                axes.axvspan(
                    time[held_out][0] / divisor,
                    time[held_out][-1] / divisor,
                    color="#ececec",
                    zorder=0,
                )
            top.set_title("grey: held out", loc="right", fontsize=7.5)
        figure.legend(*bottom.get_legend_handles_labels(), loc="outside lower center", ncols=3)
        panel_letters([top, bottom])
    return figure
