"""From the vector of a response fit to named parameters in SI, and back."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from femnl.core.choices import Background, Use
from femnl.core.errors import ParameterError
from femnl.core.fit import Fit, Parameter
from femnl.fits.covariance import derived
from femnl.observe.response.sweeps import Array, Complex, Sweeps
from femnl.observe.response.theta import Layout
from femnl.resonator import critical_alpha

UNITS = {
    "frequency": "Hz",
    "linewidth": "Hz",
    "alpha_ratio": "",
    "damping_ratio": "",
    "y_max": "V/V",
    "phase": "rad",
    "delay": "s",
}


@dataclass(frozen=True, repr=False)
class ResponseFit(Fit):
    """The fit of a driven response, and the model that it holds.

    background: none, constant or slope; driven: whether that grows with the drive; delayed: what
    the delay turns (none, all, resonance); duffing: whether there is a Duffing term; phase_sign: −1
    where the data follow exp(−iωt) and were conjugated; errors: whether standard deviations are as
    the noise is stated, scaled, or withheld; use: what of the data was fitted; evidence: by how
    much the criterion of each model that was tried is above that of this one.
    """

    background: Background = "none"
    driven: bool = False
    delayed: str = "all"
    duffing: bool = True
    phase_sign: int = 1
    errors: str = "stated"
    use: Use = "complex"
    evidence: Mapping[str, float] = field(default_factory=dict)


def natural(layout: Layout, theta: Array) -> tuple[list[str], Array, Array]:
    """Return names, values in SI and the derivatives of the values by θ, which are diagonal."""
    f0, w, ratio, damping, gain, phase, tau = layout.split(theta)
    entries = [("frequency", f0, layout.width), ("linewidth", w, w), ("alpha_ratio", ratio, 1.0)]
    entries += [("damping_ratio", damping, 1.0)] if layout.damping else []
    if layout.gain:
        entries += [
            (indexed("y_max", p, layout), g, g) for p, g in enumerate(gain / layout.reference)
        ]
    if layout.phase:
        entries += [
            (indexed("phase", p, layout), (a + np.pi) % (2 * np.pi) - np.pi, 1.0)
            for p, a in enumerate(phase)
        ]
        entries.append(("delay", tau, 1 / layout.span))
    entries += _background(layout, theta)
    names, values, slopes = zip(*entries, strict=True)
    return list(names), np.array(values), np.array(slopes)


def _background(layout: Layout, theta: Array) -> list[tuple[str, float, float]]:
    """Return names, values and slopes of C₀ [V] and C₁ [V/Hz], per volt of drive where driven."""
    per = layout.reference if layout.driven else 1.0
    found = []
    for p, terms in enumerate(layout.terms(theta)):
        for k, term in enumerate(terms):
            scale = 1 / per / layout.span**k
            name = "background_slope" if k else "background"
            for part, value in (("real", term.real), ("imag", term.imag)):
                found.append((indexed(f"{name}_{part}", p, layout), value * scale, scale))
    return found


def unit(name: str, layout: Layout) -> str:
    """Return the unit of a parameter."""
    bare = name.partition("[")[0]
    if not bare.startswith("background"):
        return UNITS[bare]
    volts = "V/V" if layout.driven else "V"
    return f"{volts}/Hz" if "slope" in bare else volts


def bare_unit(name: str) -> str | None:
    """Return the unit of a parameter by its name without a position, None if there is none such.

    A background counts as one that does not grow with the drive.
    """
    if name.startswith("background"):
        return "V/Hz" if "slope" in name else "V"
    return UNITS.get(name)


def indexed(name: str, position: int, layout: Layout) -> str:
    """Return the parameter's name at a position: bare where there is only one."""
    return name if layout.n_positions == 1 else f"{name}[{position}]"


def vector(layout: Layout, fit: Fit) -> Array:
    """Return θ of a fit's parameters; what the fit does not have is 0 (y_max = 1)."""
    names, default, _ = natural(layout, np.zeros(layout.size))
    values = [
        fit.parameters[name].value if name in fit.parameters else default[k]
        for k, name in enumerate(names)
    ]
    return np.array([layout.theta_of(k, value) for k, value in enumerate(values)])


def parameters(
    sweeps: Sweeps,
    layout: Layout,
    theta: Array,
    found: Array,
    *,
    free: NDArray[np.bool_],
    sd: Array,
    force_per_volt: float | None,
    responsivity: ArrayLike | None,
) -> dict[str, Parameter]:
    """Return the parameters with standard deviations, and what follows from them.

    Args: found: covariance of all parameters, 0 of what is held; free: which are fitted; sd: of
        each parameter.
    """
    names, values, _ = natural(layout, theta)
    out = {
        name: Parameter(name, float(v), float(s), unit(name, layout))
        for name, v, s in zip(names, values, sd, strict=True)
    }
    index = {name: k for k, name in enumerate(names)}

    calibration = (
        None if responsivity is None else np.atleast_1d(np.asarray(responsivity, dtype=float))
    )
    if calibration is not None and (calibration.shape != (layout.n_positions,) or not layout.gain):
        raise ParameterError(
            f"responsivity: {calibration.size} values; give {layout.n_positions}, one for each "
            "position, and fit magnitudes"
        )

    def derive(x: Complex) -> dict[str, tuple[complex, str]]:
        f0, w, ratio = x[:3]
        result: dict[str, tuple[complex, str]] = {
            "drive": (sweeps.reference, "V"),
            "quality_factor": (f0 / w, ""),
        }
        for p in range(layout.n_positions if layout.gain else 0):
            volts = x[index[indexed("y_max", p, layout)]] * sweeps.reference
            alpha_c = complex(critical_alpha(f0, w, volts))
            result[indexed("alpha_c", p, layout)] = alpha_c, "V⁻²"
            result[indexed("alpha_y", p, layout)] = ratio * alpha_c, "V⁻²"
        if force_per_volt is not None:
            peak = force_per_volt * sweeps.reference / (4 * np.pi**2 * f0 * w)
        elif calibration is not None:
            # All positions see the same motion; their best common amplitude is the mean.
            peak = np.mean(
                [
                    x[index[indexed("y_max", p, layout)]] * sweeps.reference / s
                    for p, s in enumerate(calibration)
                ]
            )
        else:
            return result
        result["alpha"] = ratio * complex(critical_alpha(f0, w, peak)), "m⁻²"
        if layout.damping:
            result["eta"] = 4 * x[3] / peak**2, "m⁻²"
        return result

    tested = found.copy()
    if not free[2]:
        # What follows from α_y/α_c is as uncertain as the test of it
        tested[2, 2] = sd[2] ** 2
    return out | derived(derive, values, tested)
