"""Second laws of the causes: what devices do beside what an equation says.

The value `inexact` of a cause says how far it is from its first law, which is that of 0. No second
law is another cause of the library.
"""

import numpy as np
from numpy.polynomial.legendre import leggauss

from tests.blind.lab.bench import INEXACT, Array, Values

SETTLING = 3.0
"""Relaxation times within a measurement of a drift that relaxes."""
KNEE = 8
"""Power of a detector that saturates smoothly: v/(1 + |v/limit|⁸)^⅛."""
FAINT = 1e-6
PATCH = 2e-5
"""Width [m] of a patch of `inexact` 1."""
SECOND_LINE = 1.1
"""Wavelength of a second line of the laser, over that of the first."""
RIPPLES = 1.5
"""Periods over the swept band of a ripple of the cables."""


def inexact(hidden: dict[str, Values], cause: str) -> float:
    """Return how far a cause is from its first law."""
    return hidden.get(cause, {}).get(INEXACT, 0.0)


def first(values: Values) -> Values:
    """Return the values of the first law."""
    return {name: value for name, value in values.items() if name != INEXACT}


def relaxed(time: Array | float, whole: float, much: Array | float) -> Array:
    """Return the time [s] that counts for a drift that slows down, the same at both ends."""
    slows = -np.expm1(-SETTLING * np.asarray(time) / whole) / -np.expm1(-SETTLING)
    return np.asarray(time + much * (whole * slows - time))


def saturating(drive: Array, kappa: Array, much: Array) -> Array:
    """Return tanh(√(3κ)V)/√(3κ) over V/(1 + κV²): equal in the third order of V."""
    x = np.maximum(np.sqrt(3 * np.maximum(kappa, 0.0)) * drive, FAINT)
    return np.asarray(1 + much * (np.tanh(x) / x * (1 + x**2 / 3) - 1))


def rippled(frequency: Array, much: float) -> Array:
    """Return the factor by which standing waves of cables colour a leak over a band."""
    place = (frequency - frequency.min()) / np.ptp(frequency)
    return np.asarray(1 + much * np.sin(2 * np.pi * RIPPLES * place + 1.0))


def rounded(v: Array, limit: float, low: float, much: float) -> Array:
    """Return v clipped to [low limit, limit], by a part of `much` without a sharp knee."""
    sharp = np.clip(v, low * limit, limit)
    if much == 0:
        return np.asarray(sharp)
    smooth = v / (1 + np.abs(v / limit) ** KNEE) ** (1 / KNEE)
    smooth = smooth if np.isfinite(low) else np.where(v > 0, smooth, v)
    return np.asarray(sharp + much * (smooth - sharp))


def late(turn: Array, much: float) -> Array:
    """Return the average of e^{−i n ω t} over errors that are spread evenly, over a normal one.

    turn: nω times the standard deviation of the errors; by quadrature.
    """
    place, share = leggauss(48)
    even = np.cos(turn[..., None] * np.sqrt(3) * place) @ share / 2
    place, share = np.polynomial.hermite_e.hermegauss(48)
    normal = np.cos(turn[..., None] * place) @ share / share.sum()
    return np.asarray(1 + much * (even / np.maximum(normal, 1e-12) - 1))


def patch(much: float) -> tuple[Array, Array, Array]:
    """Return places [m] and shares of a Gaussian patch; one place where it is none."""
    if much == 0:
        return np.zeros(1), np.zeros(1), np.ones(1)
    place, share = np.polynomial.hermite_e.hermegauss(5)
    x, y = np.meshgrid(much * PATCH * place, much * PATCH * place)
    weight = np.outer(share, share).ravel()
    return x.ravel(), y.ravel(), weight / weight.sum()


def by_wave(frequency: Array) -> Array:
    """Return t³ of each mode, t from −1 for the longest wave to 1 for the shortest."""
    t = np.interp(frequency, [frequency.min(), frequency.max()], [-1.0, 1.0])
    return np.asarray(t**3)


WAVES = "by (1 + e t³) more for short waves than for long ones"
LAWS: dict[str, dict[str, str]] = {
    "spectrum": {
        "added_mass": "a Gaussian patch of up to some 10 µm",
        "aspect_ratio": WAVES,
        "bending_stiffness": WAVES,
        "clamp_loss": WAVES,
        "compliant_clamp": WAVES,
        "frame_mode": "a second mode of the frame beside it, of a part of its coupling",
        "frequency_drift": "a drift that relaxes exponentially",
        "gas_damping": WAVES,
        "gas_loading": WAVES,
        "hole_dispersion": WAVES,
        "shear_stress": WAVES,
        "stress_anisotropy": WAVES,
        "tension_gradient": WAVES,
        "trapped_gas": WAVES,
        "yielding_edge": WAVES,
    },
    "electrode": {
        "layer_thickness": WAVES,
    },
    "response": {
        "crosstalk": "standing waves in the cables colour it",
        "detector_saturation": "a smooth knee",
        "drive_compression": "a hyperbolic tangent",
        "fano_background": "a second resonance of the piezo",
        "frequency_drift": "a drift that relaxes exponentially",
        "group_delay": "a delay that depends on the frequency",
        "internal_resonance": "a partner that the drive detunes",
        "lock_in_filter": "one more pole, of another corner",
        "nonlinear_damping": "a term in |A|⁴ beside |A|²",
        "nonlinear_readout": "a Lorentzian loss of contrast beside the sine",
        "one_sided_saturation": "a smooth knee",
        "quadratic_stiffness": "the next order of the frequency in the amplitude",
        "quintic_stiffness": "a term in A⁷ beside A⁵",
        "sloping_background": "standing waves in the cables colour it",
        "unsettled_mode": "points that take unequal times",
    },
    "map": {
        "crosstalk": "pick-up that depends on where the stage is",
        "detector_bandwidth": "a second pole",
        "detector_saturation": "a smooth knee",
        "doublet": "a third mode beside the partner",
        "finite_spot": "an elliptic spot",
        "mechanical_overtones": "another shape mixed into that of the overtone",
        "mode_admixture": "modes above those of the library",
        "multilayer_fringe": "a weaker second line of the laser",
        "one_sided_saturation": "a smooth knee",
        "phase_tilt": "a twist beside the slope",
        "quadratic_stiffness": "another shape of what it adds",
        "resonance_drift": "a drift that is curved in time",
        "stage_rotation": "axes that are not at right angles",
        "stage_scale": "a shear beside the stretch",
        "static_bow": "a fuller bow than the mode, as of a pressure",
        "trigger_jitter": "errors that are spread evenly",
    },
    "series": {
        "electrostatic_softening": "a term in V⁴",
        "frequency_drift": "a drift that relaxes exponentially",
        "gas_damping": "slip: the damping grows less than the pressure",
        "gas_loading": "a density that grows less than the pressure",
        "optical_spring": "a term in P²",
        "photothermal": "a term in P²",
        "thermal_stress": "a term in ΔT²",
        "trapped_gas": "a stiffness that grows less than the pressure",
    },
    "trace": {
        "crosstalk": "a leak at twice the drive beside it",
        "detector_bandwidth": "a second pole",
        "detector_saturation": "a smooth knee",
        "mechanical_overtones": "a fourth overtone",
        "multilayer_fringe": "a gap that changes from step to step",
        "one_sided_saturation": "a smooth knee",
        "quadratic_stiffness": "a third harmonic of the motion",
        "trigger_jitter": "errors that are spread evenly",
    },
    "decay": {
        "beating_pair": "a third mode beside the partner",
        "duffing_shift": "a term in A⁴ beside A²",
        "energy_exchange": "a gradual transition",
        "feed_through": "a leak that fades",
        "filter_exit": "a drift that relaxes exponentially",
        "frequency_drift": "a drift that relaxes exponentially",
        "nonlinear_damping": "a term in |A|⁴ beside |A|²",
        "working_point": "a drift that relaxes exponentially",
    },
    "record": {
        "nonlinear_damping": "a term in y⁴ beside y²",
        "quadratic_stiffness": "a term in y⁴ beside y²",
        "quintic_stiffness": "a term in y⁷ beside y⁵",
    },
}
LAWS["holes"] = LAWS["spectrum"]
"""The second law of each cause, by kind of measurement."""
