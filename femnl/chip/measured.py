"""What the measurements of a device say of its modes."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from femnl.core.errors import MeasurementError
from femnl.core.fit import Fit
from femnl.fits.decay.power import fit_decay
from femnl.fits.response.fit import fit_response
from femnl.io import measurement

APART = 1.05
"""Ratio of frequencies from which on measurements are of different modes."""


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

    Responses and decays are fitted. A decay without a frequency says nothing of a mode, and neither
    does a number that a fit does not know.

    Raises: MeasurementError where the file or a fit cannot be used.
    """
    unnamed: list[float] = []
    for node in measurement.read(path).children.values():
        dataset = node.to_dataset()
        found = list(_spectrum(dataset) if dataset.attrs["kind"] == "spectrum" else _one(dataset))
        if dataset.attrs["kind"] != "spectrum" and "mode" not in dataset.attrs:
            unnamed += [one.frequency for one in found]
        yield from found
    if unnamed and max(unnamed) > APART * min(unnamed):
        raise MeasurementError(
            f"{path}: measurements at {min(unnamed):.6g} and {max(unnamed):.6g} Hz name no mode; "
            "give each its attribute mode"
        )


def _one(dataset: xr.Dataset) -> Iterator[ModeNumbers]:
    """Yield the mode of a response or a decay."""
    mode = str(dataset.attrs.get("mode", "1"))
    if dataset.attrs["kind"] == "response":
        fit: Fit = fit_response(dataset)
        frequency = fit.parameters["frequency"]
        if np.isfinite(frequency.sd):
            yield _numbers(mode, fit, frequency.value, float(frequency.sd))
    elif dataset.attrs["kind"] == "decay" and "frequency" in dataset.attrs:
        yield _numbers(mode, fit_decay(dataset).fit, float(dataset.attrs["frequency"]), 0.0)


def _numbers(mode: str, fit: Fit, frequency: float, sd: float) -> ModeNumbers:
    quality = fit.parameters["quality_factor"]
    if not np.isfinite(quality.sd):
        return ModeNumbers(mode, frequency, sd)
    return ModeNumbers(mode, frequency, sd, quality.value, float(quality.sd))


def _spectrum(dataset: xr.Dataset) -> Iterator[ModeNumbers]:
    """Yield the modes of a spectrum; without labels they are numbered by rising frequency."""
    rated = {"quality_factor", "quality_factor_sd"} <= {str(name) for name in dataset}
    frequency = dataset["frequency"].values
    order = [k for k in np.argsort(frequency) if np.isfinite(frequency[k])]
    for rank, k in enumerate(order, start=1):
        mode = str(dataset["label"].values[k]) if "label" in dataset else str(rank)
        sd = float(dataset["frequency_sd"].values[k])
        quality = float(dataset["quality_factor"].values[k]) if rated else np.nan
        quality_sd = float(dataset["quality_factor_sd"].values[k]) if rated else np.nan
        if np.isfinite(quality) and np.isfinite(quality_sd):
            yield ModeNumbers(mode, float(frequency[k]), sd, quality, quality_sd)
        else:
            yield ModeNumbers(mode, float(frequency[k]), sd)
