"""Fits of `femnl fit` to records in time: harmonics and motion, free decays, driven oscillators."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from femnl.cli._fixed import Texts, in_si
from femnl.cli._outcome import Outcome, record, show, with_error
from femnl.cli._output import table
from femnl.core.errors import MeasurementError, ParameterError

if TYPE_CHECKING:
    import xarray as xr
    from rich.console import Group

    from femnl.core.readout import HarmonicSpectrum, PeriodicFringe
    from femnl.fits.record.terms import TermsFit
    from femnl.fits.trace.glitches import LeftOut

_WORDS = {
    "offset": "offset u₀",
    "cubic": "k₃ y³",
    "quadratic": "k₂ y²",
    "nonlinear_damping": "η y² ẏ",
}


def harmonics(
    name: str, dataset: xr.Dataset, count: int | None, fringe: PeriodicFringe | None, fixed: Texts
) -> dict[str, Outcome]:
    """Decompose into harmonics of the drive; with a wavelength, find the motion in metres too."""
    import numpy as np

    from femnl.fits.trace.decompose import decompose, most_harmonics
    from femnl.fits.trace.folding import beyond, degrees_left
    from femnl.fits.trace.glitches import found_factor, without_glitches
    from femnl.fits.trace.spot import fit_spot
    from femnl.plot.harmonics import harmonics_figure

    count = most_harmonics(dataset) if count is None else count
    spectrum = decompose(dataset, count)
    dataset, left_out = without_glitches(dataset, count)
    if left_out:
        spectrum = decompose(dataset, count)
    values = {
        "real": spectrum.values.real,
        "imag": spectrum.values.imag,
        "sd": spectrum.values_sd,
        "noise_sd": spectrum.noise_sd,
    }
    found = {"drive_frequency": spectrum.drive_frequency, "harmonic": spectrum.harmonic, **values}
    if "wavelength" not in dataset.attrs:
        if fixed:
            raise ParameterError(
                f"--fix {next(iter(fixed))}: {name} has no wavelength, so its harmonics alone are "
                "found, which have no parameters to hold; leave it out"
            )
        return {
            name: Outcome(
                found,
                _harmonics_shown(name, spectrum, left_out),
                {"harmonics": partial(harmonics_figure, spectrum)},
            )
        }
    held = in_si(fixed, {"contrast": "V", "fringe_phase": "rad"}.get)
    wavelength = float(dataset.attrs["wavelength"])
    degrees = degrees_left(dataset, int(spectrum.harmonic.max()))
    noise = float(dataset.attrs.get("noise_sd", 0.0)) * found_factor(dataset, spectrum, degrees)
    motion = fit_spot(spectrum, wavelength, fringe, held, beyond(dataset, spectrum, noise))
    steps = {
        key: getattr(motion, key) for key in ("amplitude", "amplitude_sd", "phase", "phase_sd")
    }
    strongest = int(np.argmax(motion.amplitude))
    value, sd = with_error(motion.amplitude[strongest] * 1e9, motion.amplitude_sd[strongest] * 1e9)
    said = (
        f"  largest amplitude {value} ± {sd} nm, at step {strongest + 1} of {len(motion.amplitude)}"
    )
    return {
        name: Outcome(
            found,
            _harmonics_shown(name, spectrum, left_out),
            {"harmonics": partial(harmonics_figure, spectrum, motion)},
        ),
        f"{name}, motion": Outcome(
            record(motion.fit) | steps, [*show(f"{name}, motion", motion.fit), said], {}
        ),
    }


def _harmonics_shown(name: str, spectrum: HarmonicSpectrum, left_out: LeftOut) -> list[Group | str]:
    import numpy as np

    strongest = int(np.argmax(np.abs(spectrum.values[1:]).max(axis=0)))
    rows = [
        [f"{n}", f"{abs(value) * 1e3:.4g}", f"{np.degrees(np.angle(value)):.1f}", f"{sd * 1e3:.2g}"]
        for n, value, sd in zip(
            spectrum.harmonic,
            spectrum.values[:, strongest],
            spectrum.values_sd[:, strongest],
            strict=True,
        )
    ]
    title = (
        f"{name}: harmonics at the strongest step, drive "
        f"{spectrum.drive_frequency[strongest]:.9g} Hz"
    )
    shown: list[Group | str] = [table(title, ["harmonic", "|V| (mV)", "phase (°)", "± (mV)"], rows)]
    if left_out:
        where, sigma = left_out[0]
        shown.append(
            f"  left out as glitches: {len(left_out)}, the largest of {sigma:.3g}σ at {where}"
        )
    if spectrum.correlation_length != 1:
        shown.append(
            "  the noise is not white: ± is that of each harmonic's frequency, and "
            f"{spectrum.correlation_length:.3g} neighbouring samples count as one"
        )
    return shown


def ringdown(name: str, dataset: xr.Dataset, fixed: Texts, *, envelope: bool) -> dict[str, Outcome]:
    """Fit the decay in every step.

    An envelope is the magnitude of a signal demodulated at the step's drive frequency.
    """
    from femnl.fits.decay.ringdown import UNITS, fit_ringdown
    from femnl.plot.decays import ringdown_figure

    held = in_si(fixed, UNITS.get)
    outcomes = {}
    time = dataset["time"].values
    for step in range(dataset.sizes["step"]):
        own = name if dataset.sizes["step"] == 1 else f"{name}, step {step + 1}"
        signal = dataset["voltage"].values[step]
        tone = (
            float(dataset["drive_frequency"].values[step])
            if envelope and "drive_frequency" in dataset.coords
            else None
        )
        noise = dataset.attrs.get("noise_sd")
        fit = fit_ringdown(
            time,
            signal,
            "magnitude" if envelope else "voltage",
            frequency=tone,
            noise_sd=noise,
            fixed=held,
        )
        outcomes[own] = Outcome(
            record(fit), show(own, fit), {"ring-down": partial(ringdown_figure, time, signal, fit)}
        )
    return outcomes


def oscillator(
    name: str, dataset: xr.Dataset, held_out: slice | None, fixed: Texts
) -> dict[str, Outcome]:
    """Fit the oscillator that turns the drive into the voltage, one term after the other."""
    import numpy as np

    from femnl.fits.record.terms import fit_terms
    from femnl.plot.decays import oscillator_figure

    if held_out is not None and not held_out.stop <= dataset.sizes["time"]:
        raise MeasurementError(
            f"--held-out {held_out.start}:{held_out.stop}: {name} has only "
            f"{dataset.sizes['time']} samples"
        )
    # In units of drive and output, which a file does not name
    models = fit_terms(dataset, held_out, in_si(fixed, lambda _: ""))
    rows = [
        [
            _title(model),
            f"{model.fitted * 1e3:.4g}",
            "–" if np.isnan(model.held_out) else f"{model.held_out * 1e3:.4g}",
        ]
        for model in models
    ]
    errors = {_title(model): model.error for model in models}
    steps = [
        {"terms": model.terms, "rms_fitted": model.fitted, "rms_held_out": model.held_out}
        | record(model.fit)
        for model in models
    ]
    title = f"{name}: rms error of the free run, which is given the drive alone"
    return {
        name: Outcome(
            {"models": steps},
            [
                table(title, ["equation", "fitted (mV)", "held out (mV)"], rows),
                *show(f"{name}, {_title(models[-1])}", models[-1].fit),
            ],
            {"oscillator": partial(oscillator_figure, dataset, errors, held_out)},
        )
    }


def _title(model: TermsFit) -> str:
    return f"+ {_WORDS[model.terms[-1]]}" if model.terms else "linear: m ÿ + c ẏ + k y"
