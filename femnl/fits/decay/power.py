"""Fit a record of a decay as an analyser wrote it, with all its phases."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import xarray as xr

from femnl.core.decay import DecayFit
from femnl.core.errors import ParameterError
from femnl.core.fit import Fit, Parameter
from femnl.fits.decay.interruptions import runs
from femnl.fits.decay.stretch import Found
from femnl.fits.decay.terms import RATE_SIGMAS, fit_law
from femnl.fits.held import Held, hold_fixed
from femnl.observe.decay.law import UNITS, Array, Term
from femnl.observe.decay.naming import phases
from femnl.observe.decay.phases import Segmentation, logical, segment
from femnl.observe.decay.record import DB, PowerRecord, power_record

TERM_NOTES: Mapping[Term, str] = {
    "damping": "the decay is faster at the start: nonlinear damping; the quality factor is that of "
    "small motion",
    "pair": "the power beats: a second mode is in the filter; the quality factor is that of the "
    "stronger one at the begin",
    "exit": "the power falls away from the line as where the frequency leaves the filter; the mode "
    "is taken as tuned to 0.1 dB at the begin of the decay, which limits the error",
}
"""What is said of each term of the law."""
LEAK_NOTE = (
    "the power beats with a tone that stays, as where a drive leaks on; the quality factor is that "
    "of the mode that decays into it"
)
STAYS = 0.05
"""Rate of a partner, in parts of the mode's, up to which it is a tone that stays."""
TUNED_WITHIN = 0.1
"""dB that the filter may take from a mode that an analyser was tuned to by its peak."""


def fit_decay(
    dataset: xr.Dataset,
    *,
    frequency: float | None = None,
    fixed: Mapping[str, float] | None = None,
) -> DecayFit:
    """Fit a decay under the noise of an analyser, and find it in the record first.

    The power in the filter is S = S₀ e^{−γτ} with noise of mean power N₀ + κS, added as complex
    amplitudes. Change points of the record find the decay; interruptions are left out and listed.

    Args:
        dataset: of kind `decay`: time (n,) and power [dB], magnitude [V], or real and imag [V].
        frequency: of the mode [Hz], where not the attribute of the dataset.
        fixed: values by parameter name in the units below, which are held. The decay and the terms
            of its law are found with all free; then the rest is fitted once more.

    Returns:
        level [dB] at the begin of the decay, decay_rate γ [1/s], floor N₀ [dB], wander [dB], the
        rms of the power in dB where the signal is strong; derived quality_factor 2πf/γ, linewidth
        γ/2π [Hz]. Standard deviations allow for noise that is correlated from point to point.

    Raises:
        MeasurementError: another kind of data, fewer than 16 points, or nothing that falls.
        ParameterError: a frequency that is not positive and finite, a name in `fixed` that the law
            does not have, or a value that is none.
    Valid: the decay is straight between interruptions; N ≪ S at its begin.
    """
    if frequency is not None and not 0 < frequency < np.inf:
        raise ParameterError(f"frequency = {frequency:g} Hz: must be positive and finite")
    record = power_record(dataset)
    segmentation, found = fit_law(record, segment(record.time, record.power))
    tone = frequency if frequency is not None else record.frequency
    held = hold_fixed(found.likelihood.names, fixed, "this decay")
    return _result(record, segmentation, _again(found, held), tone, held)


def _again(found: Found, held: Held) -> Found:
    """Return the fit of the same points and the same law with some parameters held."""
    if held.free.all():
        return found
    likelihood = found.likelihood
    values = np.array(
        [
            _of_order_one(found, name, value)
            for name, value in zip(held.names, held.values, strict=True)
        ]
    )
    best, value = likelihood.fit(found.values, values)
    covariance, correlation = likelihood.covariance(best, values)
    return replace(found, values=best, value=value, covariance=covariance, correlation=correlation)


def _of_order_one(found: Found, name: str, value: float) -> float:
    """Return a held value as the likelihood counts it, NaN for a free one.

    Raises: ParameterError for a wander or a rate that cannot be.
    """
    likelihood = found.likelihood
    if name in ("level", "floor"):
        return float((value - found.stretch.reference) / DB)
    if np.isnan(value):
        return value
    if name == "wander":
        if value <= 0:
            raise ParameterError(f"fixed: wander = {value:g} dB: must be positive")
        return float(np.log(0.5 * likelihood.averages * (value / DB) ** 2))
    if value < 0 and name in ("decay_rate", "damping_ratio", "partner_rate", "exit_rate"):
        raise ParameterError(f"fixed: {name} = {value:g}: must not be negative")
    return value / float(likelihood.units[likelihood.names.index(name)])


def _result(
    record: PowerRecord,
    segmentation: Segmentation,
    found: Found,
    frequency: float | None,
    held: Held,
) -> DecayFit:
    """Put a fit into SI units and words."""
    likelihood = found.likelihood
    parameters, covariance = _parameters(found)
    parameters = held.ordered(parameters)
    notes = _notes(record, segmentation, found)
    if frequency is None:
        notes.append("frequency is not given: the decay rate stands without a quality factor")
    residual = np.full(len(record.time), np.nan)
    residual[found.stretch.used] = likelihood.residual(found.values)
    mean = np.full(len(record.time), np.nan)
    signal, _ = likelihood.signal(found.values)
    total = signal + likelihood.noise(found.values, signal)
    mean[found.stretch.used] = found.stretch.reference + DB * np.log(total)
    scores = residual[found.stretch.used]
    n_points = len(scores)
    n_free = int(np.count_nonzero(held.free))
    fit = Fit(
        _derived(parameters, frequency),
        held.inner(covariance),
        float(scores @ scores) / max(n_points - n_free, 1),
        n_points,
        n_free,
        (*held.notes, *notes),
    )
    floor = parameters["floor"].value
    return DecayFit(
        fit,
        phases(record.time, segmentation, floor),
        record.time,
        record.power,
        found.stretch.used,
        mean,
        residual,
        found.correlation,
    )


def _parameters(found: Found) -> tuple[dict[str, Parameter], Array]:
    """Return parameters in SI and dB, and their covariance."""
    likelihood = found.likelihood
    scale = likelihood.units.copy()
    offset = np.zeros(len(scale))
    values = found.values.copy()
    # Level and floor are ln of powers; κ is told as the rms of a strong signal in dB.
    scale[[0, 2]] = DB
    offset[[0, 2]] = found.stretch.reference
    wander = DB * float(np.sqrt(2 * np.exp(values[3]) / likelihood.averages))
    scale[3] = 0.5 * wander
    si = values * scale + offset
    si[3] = wander
    with np.errstate(invalid="ignore"):
        covariance = found.covariance * np.outer(scale, scale)
    sd = np.sqrt(np.diag(covariance))
    if "exit_rate" in likelihood.names and sd[1] > 0:
        # A mode that starts beside the filter's centre falls away at once, as if damped more.
        bend = max(float(si[likelihood.names.index("exit_rate")]), 0.0)
        sd[1] = np.hypot(sd[1], 2 * np.sqrt(bend * TUNED_WITHIN / DB))
    parameters = {
        name: Parameter(name, float(v), float(s), UNITS[name])
        for name, v, s in zip(likelihood.names, si, sd, strict=True)
    }
    return parameters, covariance


def _derived(parameters: Mapping[str, Parameter], frequency: float | None) -> dict[str, Parameter]:
    """Add linewidth and quality factor."""
    rate = parameters["decay_rate"]
    width = Parameter("linewidth", rate.value / (2 * np.pi), rate.sd / (2 * np.pi), "Hz")
    found = {**parameters, "linewidth": width}
    if frequency is not None and rate.value > 0:
        quality = 2 * np.pi * frequency / rate.value
        found["quality_factor"] = Parameter(
            "quality_factor", quality, quality * rate.sd / rate.value, ""
        )
    return found


def _floor_left_out(segmentation: Segmentation) -> float | None:
    """Return the begin [s] of what lies below the decay and was not taken for its floor, if any."""
    last = segmentation.decay[-1]
    taken = segmentation.floor[-1] if segmentation.floor else last
    end = segmentation.pieces[last].low
    rest = segmentation.pieces[taken + 1 :]
    below = [piece for piece in rest if piece.middle < end]
    return below[0].begin if below else None


def _leaks(found: Found) -> bool:
    """Whether what a decay beats with does not decay itself."""
    if "pair" not in found.likelihood.terms:
        return False
    place = found.likelihood.names.index("partner_rate")
    rate = float(found.values[place])
    error = RATE_SIGMAS * float(np.sqrt(found.covariance[place, place]))
    return rate < STAYS * found.values[1] or bool(rate < error < found.values[1])


def _notes(record: PowerRecord, segmentation: Segmentation, found: Found) -> list[str]:
    """Say what was left out, assumed, and not seen."""
    leaks = _leaks(found)
    notes = [LEAK_NOTE] if leaks else [TERM_NOTES[term] for term in found.likelihood.terms]
    decay = [segmentation.pieces[k] for k in segmentation.decay]
    inside = (record.time >= decay[0].begin) & (record.time <= decay[-1].end)
    inside |= logical(segmentation, segmentation.floor, len(record.time))
    missed = inside & ~found.stretch.used
    if missed.any():
        count = np.count_nonzero(missed)
        begins = [record.time[first] for first, _ in runs(missed)]
        listed = ", ".join(f"{t:.4g}" for t in begins[:6]) + (", …" if len(begins) > 6 else "")
        notes.append(
            f"{count} point{'s' if count > 1 else ''} left out where decay or floor are "
            f"interrupted, from {listed} s"
        )
    if found.correlation > 1.5:
        notes.append(
            f"noise is correlated over {found.correlation:.3g} points; the errors allow for it"
        )
    later = _floor_left_out(segmentation)
    bent = leaks or "exit" in found.likelihood.terms
    if later is not None and not bent:
        notes.append(
            f"the floor from {later:.4g} s on is not fitted: the power does not come to it along "
            "the decay; the fitted floor may differ from it"
        )
    elif not segmentation.floor and not bent:
        notes.append("the record ends before the decay reaches a floor")
    if segmentation.recorded < len(record.time):
        end = record.time[segmentation.recorded]
        notes.append(f"from {end:.4g} s on nothing was recorded: the trace is smooth to its end")
    return notes
