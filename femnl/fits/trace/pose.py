"""From traces in a file to their model: their harmonics, and the motion that a sine shows."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from femnl.core.checkpoint import Checkpoint
from femnl.core.effect import ParameterSpec
from femnl.core.errors import MeasurementError
from femnl.core.numbers import engineering
from femnl.fits.trace.decompose import PER_HARMONIC, decompose, most_harmonics, refuse_undriven
from femnl.fits.trace.folding import SMOOTH, beyond_of, degrees_left, folded
from femnl.fits.trace.glitches import found_factor, without_glitches
from femnl.fits.trace.spot import fit_spot
from femnl.observe.film import SimulatedFilm
from femnl.observe.trace.model import TraceModel
from femnl.optics.airy import stack_scales

MOST_STEPS = 12
"""Steps of the drive that are compared."""
HIGHEST = 128
"""Harmonics that are predicted of a clipped signal: those beyond the measured ones are folded onto
them by the sampling, or beat in what they leave."""


def pose(
    dataset: xr.Dataset, film: SimulatedFilm, checkpoint: Checkpoint | None = None
) -> TraceModel:
    """Return the model of traces at one spot under a fringe.

    Raises: MeasurementError where the wavelength is not known, and for too few samples.
    """
    if "wavelength" not in dataset.attrs:
        raise MeasurementError(
            "trace: neither wavelength nor drive_voltage is there: add the laser's wavelength [m], "
            "or the drive that was recorded"
        )
    refuse_undriven(dataset)
    wavelength = float(dataset.attrs["wavelength"])
    raw = dataset.isel(step=_chosen(dataset))
    n_harmonics = most_harmonics(raw)
    if n_harmonics < 2:
        raise MeasurementError(
            "trace: these samples separate fewer than two harmonics; sample faster or record longer"
        )
    traces, left_out = without_glitches(raw, n_harmonics)
    spectrum = decompose(traces, n_harmonics)
    degrees = degrees_left(traces, n_harmonics)
    factor = found_factor(traces, spectrum, degrees)
    kept = spectrum.harmonic > 0
    harmonic = np.asarray(spectrum.harmonic[kept], np.int64)
    frequency = spectrum.drive_frequency
    n_steps = len(frequency)
    stated = dataset.attrs.get("noise_sd")
    seen = float(np.sqrt(np.mean(spectrum.noise_sd**2)))
    noise = seen if stated is None else factor * float(stated)
    smooth = folded(traces, frequency, n_harmonics, SMOOTH)
    beyond = beyond_of(smooth, spectrum, degrees, 0.0 if stated is None else noise)
    sine = fit_spot(spectrum, wavelength, beyond=beyond)
    contrast = sine.fit["contrast"]
    theta = sine.fit["fringe_phase"]
    deepest = 40 * wavelength / (4 * np.pi)
    thinned = (
        f"; {n_steps} of {dataset.sizes['step']} steps compared"
        if n_steps < dataset.sizes["step"]
        else ""
    )
    origin = (
        "estimated from what the harmonics leave: noise_sd is not in the file"
        if stated is None
        else ("as stored" if factor == 1 else f"{factor:.3g} times what is stored")
    )
    length = spectrum.correlation_length
    coloured = "" if length == 1 else f"; {length:.3g} neighbouring samples count as one"
    return TraceModel(
        film=film,
        wavelength=wavelength,
        harmonic=harmonic,
        frequency=frequency,
        measured=spectrum.values[kept],
        sd=spectrum.values_sd[kept] * (noise / spectrum.noise_sd),
        noise=noise,
        # What the harmonics leave of a record is noise of the size that the file states, or
        # something else beats there.
        left=np.empty(0) if stated is None else spectrum.noise_sd,
        degrees=degrees,
        folded=(
            folded(traces, frequency, n_harmonics, HIGHEST),
            smooth,
        ),
        mode=int(np.argmin(np.abs(film.modes.frequency - np.median(frequency)))),
        base=(
            ParameterSpec("contrast", "V", -10 * abs(contrast), 10 * abs(contrast)),
            ParameterSpec("theta", "rad", theta - np.pi, theta + np.pi),
            *(ParameterSpec(f"amplitude[{i}]", "m", 0.0, deepest) for i in range(n_steps)),
            *(
                ParameterSpec(f"motion_phase[{i}]", "rad", p - 2 * np.pi, p + 2 * np.pi)
                for i, p in enumerate(sine.phase)
            ),
        ),
        start=np.concatenate([[contrast, theta], sine.amplitude, sine.phase]),
        scales={
            "wavelength": wavelength,
            "period": float(1 / np.median(frequency)),
            "slope": abs(contrast),
            **stack_scales(film.model.stack),
        },
        noise_factor=factor,
        correlation_length=spectrum.correlation_length,
        independent=spectrum.independent,
        left_out=left_out,
        notes=(
            f"trace: noise {engineering(float(noise), 'V')} per sample, {origin}{coloured}",
            f"trace: {len(harmonic)} harmonics at each step{thinned}; metres are those at the spot",
        ),
    )


def _chosen(dataset: xr.Dataset) -> NDArray[np.int64]:
    """Return the steps that are compared, evenly spaced; those only partly without gaps go."""
    usable = np.flatnonzero(np.isfinite(dataset["voltage"].values).sum(axis=1) > 2 * PER_HARMONIC)
    if not len(usable):
        raise MeasurementError(
            f"trace: no step has more than {2 * PER_HARMONIC} samples; record longer"
        )
    return usable[np.unique(np.linspace(0, len(usable) - 1, MOST_STEPS).round().astype(np.int64))]
