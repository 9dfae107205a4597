"""What the measurements of a device say of its modes."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from femnl.core.fit import Fit
from femnl.fits.decay.power import fit_decay
from femnl.fits.response.fit import fit_response
from femnl.io import measurement


@dataclass(frozen=True)
class ModeNumbers:
    """Frequency [Hz] and quality factor of a mode, with their standard deviations, 0 if unknown."""

    mode: str
    frequency: float
    frequency_sd: float = 0.0
    quality: float | None = None
    quality_sd: float = 0.0


def measured(path: Path) -> Iterator[ModeNumbers]:
    """Yield the modes in the spectra, responses and decays of a file; other kinds are passed over.

    Responses and decays are fitted. A decay without a frequency says nothing of a mode.

    Raises: MeasurementError where the file or a fit cannot be used.
    """
    for node in measurement.read(path).children.values():
        dataset = node.to_dataset()
        mode = str(dataset.attrs.get("mode", "1"))
        if dataset.attrs["kind"] == "spectrum":
            yield from _spectrum(dataset)
        elif dataset.attrs["kind"] == "response":
            fit = fit_response(dataset)
            yield _numbers(mode, fit, fit["frequency"], _sd(fit, "frequency"))
        elif dataset.attrs["kind"] == "decay" and "frequency" in dataset.attrs:
            yield _numbers(mode, fit_decay(dataset).fit, float(dataset.attrs["frequency"]), 0.0)


def _numbers(mode: str, fit: Fit, frequency: float, sd: float) -> ModeNumbers:
    return ModeNumbers(mode, frequency, sd, fit["quality_factor"], _sd(fit, "quality_factor"))


def _sd(fit: Fit, name: str) -> float:
    """Return a standard deviation, 0 where the fit withholds it."""
    sd = fit.parameters[name].sd
    return float(sd) if np.isfinite(sd) else 0.0


def _spectrum(dataset: xr.Dataset) -> Iterator[ModeNumbers]:
    rated = {"quality_factor", "quality_factor_sd"} <= {str(name) for name in dataset}
    for k, frequency in enumerate(dataset["frequency"].values):
        if not np.isfinite(frequency):
            continue
        mode = str(dataset["label"].values[k]) if "label" in dataset else str(k + 1)
        sd = float(dataset["frequency_sd"].values[k])
        quality = float(dataset["quality_factor"].values[k]) if rated else np.nan
        if np.isfinite(quality):
            quality_sd = float(dataset["quality_factor_sd"].values[k])
            yield ModeNumbers(mode, float(frequency), sd, quality, quality_sd)
        else:
            yield ModeNumbers(mode, float(frequency), sd)
