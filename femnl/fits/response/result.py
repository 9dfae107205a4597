"""From the vector of a response fit to named parameters in SI, and back."""

import numpy as np
from numpy.typing import ArrayLike

from femnl.core.errors import ParameterError
from femnl.core.fit import Fit, Parameter
from femnl.fits.covariance import derived
from femnl.observe.response.branches import Layout
from femnl.observe.response.sweeps import Array, Complex, Sweeps
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
    names, values, slopes = zip(*entries, strict=True)
    return list(names), np.array(values), np.array(slopes)


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
    force_per_volt: float | None,
    responsivity: ArrayLike | None,
) -> dict[str, Parameter]:
    """Return the free parameters with standard deviations, and what follows from them."""
    names, values, _ = natural(layout, theta)
    sd = np.sqrt(np.diag(found))
    out = {
        name: Parameter(name, float(v), float(s), UNITS[name.partition("[")[0]])
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
            y = x[index[indexed("y_max", p, layout)]]
            alpha_c = complex(critical_alpha(f0, w, y))
            result[indexed("alpha_c", p, layout)] = alpha_c, "V²/V²"
            result[indexed("alpha_y", p, layout)] = ratio * alpha_c, "V²/V²"
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

    return out | derived(derive, values, found)
