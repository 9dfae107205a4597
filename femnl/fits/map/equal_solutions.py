"""Equal solutions of harmonic maps: signs of contrast, amplitude and phase, and the one told."""

from collections.abc import Sequence

import numpy as np

from femnl.core.readout import Array
from femnl.fits.map.residuals import MapResiduals
from femnl.optics.unit_fringe import OVERTONE

SYMMETRIC = 1e-9
"""Imaginary parts of the overtones below this make a fringe even about its extremum, as a film
without absorption does.
"""


def canonical(problem: MapResiduals, vector: Array) -> Array:
    """Return one of the equal solutions: U > 0; V_C > 0 for a cosine; and one sign of θ.

    The θ nearer to the fringe as given is chosen, or else the one with sin θ ≥ 0.

    V_C → −V_C, θ → θ + π turns even overtones round; θ → −θ, φ → φ + π their imaginary parts.
    Angles are put into (−π, π]. A solution that this would turn away from what is held stays.
    """
    free = problem.held.free
    turned = _turned(problem, vector)
    if np.allclose(turned[~free], vector[~free], rtol=1e-12, atol=1e-15):
        return problem.held.put(turned)
    return _with_free_angles(problem, vector)


def _turned(problem: MapResiduals, vector: Array) -> Array:
    """Return the solution of `canonical` for free parameters."""
    values = problem.unpack(vector)
    for data, own in zip(problem.maps, values, strict=True):
        if vector[0] < 0:
            own["motion_phase"] += np.pi
        if len(data.series.coefficients) == 2 and own["contrast"] < 0:
            _reverse_contrast(own, problem.overtones)
        symmetric = np.abs(data.series.coefficients.imag).max() < SYMMETRIC
        if symmetric and _mirror_is_nearer(own["fringe_phase"], data.nominal):
            _mirror_fringe(own, problem.overtones)
        for angle in ("fringe_phase", "motion_phase"):
            own[angle] = wrap(own[angle])
    return problem.pack(abs(vector[0]), values)


def _reverse_contrast(values: dict[str, float], overtones: Sequence[int]) -> None:
    """Replace V_C by −V_C and θ by θ + π, which gives the same signal of a cosine."""
    values["contrast"] *= -1
    values["fringe_phase"] += np.pi
    even = overtones[::2]
    _negate(values, [OVERTONE.format(k=k, part=part) for k in even for part in ("real", "imag")])


def _mirror_is_nearer(theta: float, nominal: float | None) -> bool:
    """Whether −θ, rather than θ, is near the fringe as given, or else has sin θ ≥ 0."""
    if nominal is None:
        return bool(np.sin(theta) < 0)
    return bool(np.cos(theta + nominal) > np.cos(theta - nominal))


def _mirror_fringe(values: dict[str, float], overtones: Sequence[int]) -> None:
    """Replace θ by −θ and φ by φ + π, which gives the same signal of a symmetric fringe."""
    values["fringe_phase"] *= -1
    values["motion_phase"] += np.pi
    _negate(values, [OVERTONE.format(k=k, part="imag") for k in overtones])


def _with_free_angles(problem: MapResiduals, vector: Array) -> Array:
    """Return the same solution with the angles that are free in (−π, π], and U > 0 if it is."""
    values = problem.unpack(vector)
    free = problem.held.free
    phases = [
        1 + i * len(problem.own) + problem.own.index("motion_phase") for i in range(len(values))
    ]
    turns = bool(vector[0] < 0 and free[0] and free[phases].all())
    for own in values:
        own["motion_phase"] += np.pi if turns else 0.0
        for angle in ("fringe_phase", "motion_phase"):
            own[angle] = wrap(own[angle])
    return problem.held.put(problem.pack(-vector[0] if turns else vector[0], values))


def wrap(angle: float) -> float:
    """Return the equal angle in (−π, π]."""
    return float(np.pi - (np.pi - angle) % (2 * np.pi))


def _negate(values: dict[str, float], names: Sequence[str]) -> None:
    for name in names:
        values[name] *= -1
