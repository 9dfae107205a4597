"""Fit free decays: frequency, quality factor, and how both change with amplitude."""

from collections.abc import Mapping
from dataclasses import replace
from typing import get_args

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import leastsq

from femnl.core.errors import MeasurementError, ParameterError
from femnl.core.fit import Fit, Parameter
from femnl.fits.covariance import derived, natural_units
from femnl.fits.decay.model import Array, Decay, Numbers, Signal, strongest
from femnl.fits.decay.whiteness import ResidualPower, residual_power
from femnl.fits.held import Held, hold_fixed

UNITS = {
    "amplitude": "V",
    "decay_rate": "1/s",
    "damping_ratio": "",
    "phase": "rad",
    "frequency": "Hz",
    "pull": "Hz",
    "offset": "V",
    "floor": "V²",
}
CLOSE = 1e-10
# The weights of squared magnitudes depend on the decay: so often they are set anew.
ROUNDS = 5
SUSTAINED = -0.5
"""Damping ratio below which a power falls at less than half of its last rate at first."""
ROUNDING = 1e-12
"""Of the largest value, what is left of it as numbers are rounded."""
FEWEST = 16
"""Samples below which nothing is fitted."""


def fit_ringdown(
    time: ArrayLike,
    signal: ArrayLike,
    kind: Signal = "voltage",
    *,
    frequency: float | None = None,
    nonlinear: bool = True,
    noise_sd: float | None = None,
    responsivity: float | None = None,
    fixed: Mapping[str, float] | None = None,
) -> Fit:
    """Fit a free decay v(t) = Re A(t).

    |A|² = A₀² e^{−γt}/(1 + d s), arg A = φ + 2πf t + (2π·pull/γ) ln(1 + d s)/d, s = 1 −
    e^{−γt}.

    d = ηA₀²/4 is the nonlinear damping and pull = ⅜ f α A₀² the shift of the frequency at the first
    amplitude A₀; f and the quality factor are those of small motion.

    Args:
        time: (n,) [s]; the decay is counted from the first.
        signal: (n,) [V]: the `voltage` itself, its `complex` amplitude demodulated at `frequency`,
            or the `magnitude` of that.
        kind: which of these.
        frequency: of demodulation [Hz]; for a magnitude, that of the mode, which gives the quality
            factor.
        nonlinear: whether to fit d and pull (0 otherwise).
        noise_sd: [V], per sample or per quadrature; what is left of the signal where not given.
        responsivity: dV/du [V/m]; gives alpha and eta in m⁻² instead of V⁻².
        fixed: values by parameter name, SI, which are held.

    Returns:
        amplitude, decay_rate, then as far as the signal shows them damping_ratio, phase, frequency,
        pull, offset, and floor, the mean square [V²] that a magnitude decays to; derived linewidth,
        quality_factor, alpha, eta.

    Raises:
        MeasurementError: too few samples, or nothing that decays.
        ParameterError: an unknown kind, or a name in `fixed` that the fit does not have.
    Valid: ⅜ α A₀² and 1/Q ≪ 1, as `femnl.resonator.ring_down`; white noise.
    Source: Polunin, Yang, Dykman, Kenny and Shaw, Journal of Microelectromechanical Systems 25, 297
    (2016).
    """
    if kind not in get_args(Signal):
        raise ParameterError(f"kind = {kind!r}: give one of {', '.join(get_args(Signal))}")
    t = np.asarray(time, dtype=float)
    v = np.asarray(signal)
    alike = t.shape == v.shape and t.ndim == 1
    good = np.isfinite(t) & np.isfinite(v) if alike else np.zeros(0, dtype=bool)
    if np.count_nonzero(good) < FEWEST:
        raise MeasurementError(
            f"time {t.shape} and signal {v.shape}: a ring-down needs both, of at least {FEWEST} "
            "samples"
        )
    t = t[good] - t[good][0]
    v = v[good]
    if np.all(v == v[0]):
        raise MeasurementError(f"signal: is {abs(v[0]):.3g} V throughout; a ring-down decays")
    decay = Decay(t, v, kind, strongest(t, v) if kind == "voltage" else frequency or 0.0, nonlinear)
    held = _held(decay, fixed)
    values = held.put(decay.start())
    for _ in range(ROUNDS if kind == "magnitude" else 1):
        weight = 1 / decay.spread(values, noise_sd or decay.noise(values))
        values = _descend(decay, values, weight, held)
    noise = noise_sd or decay.noise(values)
    spread = decay.spread(values, noise)
    rest = (decay.data - decay.model(values)) / spread
    slopes = decay.jacobian(values) / spread[:, None]
    found, blind = held.covariance(slopes, natural_units(slopes, decay.data / spread))
    notes = [f"{np.count_nonzero(~good)} missing samples left out"] if not good.all() else []
    power = _residual_power(decay, rest, values, stated=noise_sd is not None)
    misses = power.misses and noise > ROUNDING * float(np.abs(v).max())
    if misses:
        notes.append(power.note)
        found = found * power.factor**2
    known = 1.0 if noise_sd or not misses else power.floor
    if not noise_sd:
        notes.append(
            "noise_sd is not given: what is left of the signal "
            + ("far from the mode " if misses else "")
            + f"is taken for noise, {noise * np.sqrt(known):.3g} V"
        )
    notes += _sustained(dict(zip(decay.names, values, strict=True)))
    parameters = held.ordered(_parameters(decay, values, found, frequency, responsivity))
    n_free = int(np.count_nonzero(held.free))
    chi2 = float(rest @ rest) / known / (len(rest) - n_free)
    return Fit(
        parameters, held.inner(found), chi2, len(rest), n_free, (*held.notes, *notes, *blind)
    )


def _residual_power(
    decay: Decay, rest: NDArray[np.inexact], values: Array, *, stated: bool
) -> ResidualPower:
    """Return the power of the residuals near the mode and beside it."""
    shown = dict(zip(decay.names, values, strict=True))
    frequency = shown.get("frequency", 0.0) + (decay.reference if decay.kind == "voltage" else 0.0)
    real, imag = np.split(rest, 2) if decay.kind == "complex" else (rest, None)
    residuals = real if imag is None else real + 1j * imag
    interval = float(decay.time[-1] / (len(decay.time) - 1))
    width = shown["decay_rate"] / (2 * np.pi)
    return residual_power(residuals, interval, frequency, width, stated=stated)


def _sustained(shown: Mapping[str, float]) -> list[str]:
    """Say where the amplitude hardly falls at first, as no free decay does."""
    ratio = shown.get("damping_ratio", 0.0)
    if ratio > SUSTAINED:
        return []
    return [
        f"damping_ratio = {ratio:.3g}: the amplitude hardly falls at first; the record may begin "
        "before the drive is switched off, or hold a steady tone"
    ]


def _held(decay: Decay, fixed: Mapping[str, float] | None) -> Held:
    """Return what is held, the frequency as the fit counts it from its reference."""
    held = hold_fixed(decay.names, fixed, "a ring-down")
    shift = np.array([decay.reference if name == "frequency" else 0.0 for name in decay.names])
    return replace(held, values=held.values - shift)


def fit_ringdown_trace(
    dataset: xr.Dataset,
    step: int = 0,
    *,
    nonlinear: bool = True,
    responsivity: float | None = None,
    fixed: Mapping[str, float] | None = None,
) -> Fit:
    """Fit the decay recorded in one step of a dataset of kind `trace`; see `fit_ringdown`."""
    if dataset.attrs.get("kind") != "trace":
        raise MeasurementError(
            f"kind = {dataset.attrs.get('kind')!r}: a ring-down is fitted to a measurement of "
            "kind 'trace'"
        )
    if not 0 <= step < dataset.sizes["step"]:
        raise ParameterError(f"step = {step}: the trace has steps 0 … {dataset.sizes['step'] - 1}")
    noise = dataset.attrs.get("noise_sd")
    voltage = dataset["voltage"].isel(step=step).values
    return fit_ringdown(
        dataset["time"].values,
        voltage,
        nonlinear=nonlinear,
        noise_sd=noise,
        responsivity=responsivity,
        fixed=fixed,
    )


def predict_ringdown(fit: Fit, time: ArrayLike) -> NDArray[np.complex128]:
    """Return the complex amplitude A(t) (n,) [V] of a fit, v = Re A + offset.

    Times [s] count from the first that was fitted.

    Of a magnitude it has the modulus without the noise: |v|² = |A|² + floor.
    """
    t = np.asarray(time, dtype=float)
    kind: Signal = "magnitude" if "phase" not in fit.parameters else "complex"
    decay = Decay(t, t, kind, 0.0, "damping_ratio" in fit.parameters)
    size, angle = decay.polar(np.array([fit[name] for name in decay.names]))
    return np.asarray(size * np.exp(1j * angle))


def _descend(decay: Decay, start: Array, weight: Array, held: Held) -> Array:
    """Minimise the weighted squares from the start over what is free."""

    def residual(free: Array) -> Array:
        return np.asarray((decay.model(held.whole(free)) - decay.data) * weight)

    def slopes(free: Array) -> Array:
        return decay.jacobian(held.whole(free))[:, held.free] * weight[:, None]

    best, *_ = leastsq(
        residual,
        start[held.free],
        Dfun=slopes,
        full_output=True,
        ftol=CLOSE,
        xtol=CLOSE,
        gtol=CLOSE,
    )
    return held.whole(np.asarray(best))


def _parameters(
    decay: Decay, values: Array, found: Array, frequency: float | None, responsivity: float | None
) -> dict[str, Parameter]:
    """Return the parameters in SI, and what follows from them to first order."""
    shown = dict(zip(decay.names, values, strict=True))
    if "frequency" in shown:
        shown["frequency"] += decay.reference
    if "phase" in shown:
        shown["phase"] = (shown["phase"] + np.pi) % (2 * np.pi) - np.pi
    out = {
        name: Parameter(name, float(v), float(s), UNITS[name])
        for (name, v), s in zip(shown.items(), np.sqrt(np.diag(found)), strict=True)
    }
    unit = "V⁻²" if responsivity is None else "m⁻²"

    def derive(x: Numbers) -> dict[str, tuple[complex, str]]:
        p = dict(zip(decay.names, x, strict=True))
        square = (p["amplitude"] / (responsivity or 1.0)) ** 2
        result = {"linewidth": (p["decay_rate"] / (2 * np.pi), "Hz")}
        tone = p["frequency"] + decay.reference if "frequency" in p else frequency
        if tone is not None:
            result["quality_factor"] = 2 * np.pi * tone / p["decay_rate"], ""
        if "damping_ratio" in p:
            result["eta"] = 4 * p["damping_ratio"] / square, unit
        if "pull" in p:
            result["alpha"] = 8 / 3 * p["pull"] / (tone * square), unit
        return result

    return out | derived(derive, values, found)
