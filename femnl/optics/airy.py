"""Overtones of a stack's fringe in closed form, for plane waves and for a focused beam.

The light that goes m times through the gap leaves the stack with A_m = t t′ r_w (r_b r_w)^{m−1},
so that R = |Σ_m A_m e^{−imφ}|² is a geometric series too. Time runs as exp(+iωt), and the way
through the gap gives φ = 4πd cos ϑ/λ.
"""

from dataclasses import dataclass
from itertools import zip_longest
from typing import NamedTuple

import numpy as np

from femnl.core.device import Layer, Stack
from femnl.core.errors import ParameterError
from femnl.core.readout import ComplexArray
from femnl.core.stages import Wave

FAINT = 1e-8
"""Overtones below this part of the first are left out: no map can show them."""
ANGLES = 8
"""Plane waves of a focused beam, by Gauss–Laguerre in 2 sin²ϑ/NA²."""


@dataclass(frozen=True)
class GeometricFringe:
    """R = constant + Re Σ_{k≥1} first · ratio^{k−1} e^{ikφ}.

    Overtones of the fringe of a film over a wafer fall by the same complex ratio each.
    """

    first: complex
    ratio: complex

    def coefficients(self, phase: float) -> ComplexArray:
        """Return c_k from k = 0 for a phase φ [rad]; c₀ = 0, which no harmonic shows."""
        count = 2 + int(np.log(FAINT) / np.log(np.clip(abs(self.ratio), FAINT, 0.999)))
        k = np.arange(1, count)
        return np.append(0, self.first * self.ratio ** (k - 1) * np.exp(1j * k * phase))


class _Side(NamedTuple):
    """Reflection of layers seen from above and from below, and transmission there and back."""

    above: complex
    below: complex
    through: complex


@dataclass(frozen=True)
class Film:
    """The film above the gap: its thickness [m], and its index over that of the stack's layer."""

    thickness: float
    index_scale: float = 1.0


def geometric_fringe(
    stack: Stack, wavelength: float, film: Film, sine_square: float = 0.0, *, s_wave: bool = True
) -> GeometricFringe:
    """Return the fringe of a stack that has another film, for one plane wave.

    Args: stack: layers with the gap; the film is the layer above the gap. wavelength: λ [m].
    sine_square: sin²ϑ before the stack. s_wave: whether E stands across the plane of incidence.
    Valid: coherent layers, a gap of index 1 without loss.
    Source: Born & Wolf, Principles of Optics, 7th ed., sections 1.6.2 and 7.6 (Airy's sum).
    """
    gap = stack.gap
    index = np.array([index_of(layer, wavelength) for layer in stack.layers])
    index[gap - 1] *= film.index_scale
    h = np.array([layer.thickness for layer in stack.layers])
    h[gap - 1] = film.thickness
    cosine = np.sqrt(1 - sine_square * (index[0] / index) ** 2)
    depth = 2 * np.pi / wavelength * index[1:-1] * cosine[1:-1] * h[1:-1]
    # Admittances: what is steady across a face is E and n cos ϑ E, or cos ϑ E and n E.
    n = index * cosine if s_wave else index / cosine
    upper = _side(n[: gap + 1], depth[: gap - 1])
    lower = _side(n[gap:], depth[gap:])
    ratio = upper.below * lower.above
    entered = upper.through * lower.above
    first = 2 * (np.conj(upper.above) * entered + abs(entered) ** 2 * ratio / (1 - abs(ratio) ** 2))
    return GeometricFringe(complex(np.conj(first)), complex(np.conj(ratio)))


def _side(n: ComplexArray, depth: ComplexArray) -> _Side:
    """Return what the layers between two media do, by characteristic matrices.

    Args: n: admittances of the medium before, the layers, and the medium behind. depth: phase
    [rad] on one way through each layer.
    """
    whole = np.eye(2, dtype=complex)
    for index, phase in zip(n[1:-1], depth, strict=True):
        c = np.cos(phase)
        s = 1j * np.sin(phase)
        whole = whole @ np.array([[c, s / index], [index * s, c]])
    a = n[0] * whole[0, 0]
    b = n[0] * n[-1] * whole[0, 1]
    d = n[-1] * whole[1, 1]
    total = a + b + whole[1, 0] + d
    return _Side(
        complex((a + b - whole[1, 0] - d) / total),
        complex((d + b - whole[1, 0] - a) / total),
        complex(4 * n[0] * n[-1] / total**2),
    )


_NODES = np.polynomial.laguerre.laggauss(ANGLES)


def beam_waves(
    stack: Stack, wavelength: float, film: Film, gap: float, aperture_square: float
) -> tuple[Wave, ...]:
    """Return the fringes of the plane waves that make up a focused beam, |Σ c₁| = 1.

    A linearly polarised Gaussian beam has the power e^{−2 sin²ϑ/NA²} a solid angle, NA = λ/(πw₀).
    Each wave reflects by itself, and the detector adds up their power. To first order in NA², the
    mean of e^{ikφ} is e^{ik4πd/λ}/(1 + ikd/z_R), z_R = πw₀²/λ, the overlap of the beam with itself
    after the further way 2kd; and motion turns the fringe by the factor 1 − NA²/4 less.

    Args: stack, wavelength [m], film: see `geometric_fringe`. gap: d [m]. aperture_square: NA².
    Returns: the wave on axis alone where NA = 0, else `ANGLES` of them.
    Valid: NA² ≤ 0.03 and d < z_R/2, with errors below 1e-3 of the fringe's contrast; a detector
    that takes up all reflected light.
    Source: A. E. Siegman, Lasers (1986), ch. 16 and 17; K. Creath, Appl. Opt. 28, 3333 (1989) (the
    fringe spacing under an aperture).
    """
    angles = zip(*_NODES, strict=True) if aperture_square else [(0.0, 1.0)]
    waves = []
    for node, share in angles:
        sine_square = aperture_square * node / 2
        cosine = np.sqrt(1 - sine_square)
        phase = 4 * np.pi * gap * cosine / wavelength
        each = [
            geometric_fringe(stack, wavelength, film, sine_square, s_wave=s_wave)
            for s_wave in (True, False)
        ]
        series = [one.coefficients(phase) for one in each]
        mean = [sum(column) / 2 for column in zip_longest(*series, fillvalue=0.0)]
        waves.append(Wave(np.array(mean, complex) * complex(share), wavelength / cosine))
    first = abs(sum(wave.coefficients[1] for wave in waves))
    return tuple(Wave(wave.coefficients / first, wave.wavelength) for wave in waves)


def index_of(layer: Layer, wavelength: float) -> complex:
    """Return the index n − ik listed at `wavelength` [m], but for a picometre of rounding.

    Raises: ParameterError for a wavelength that is not listed; indices are never interpolated.
    """
    for listed, index in layer.index:
        if abs(listed - wavelength) < 1e-12:
            return complex(index)
    names = ", ".join(f"{listed * 1e9:g} nm" for listed, _ in layer.index)
    raise ParameterError(
        f"no index of {layer.material} at {wavelength * 1e9:g} nm: the stack lists {names}; "
        "add it to the geometry's [readout]"
    )


def stack_scales(stack: Stack | None) -> dict[str, float]:
    """Return the thicknesses [m] of gap and film, as scales of parameters, where there are any."""
    if stack is None:
        return {}
    found = {"stack": stack.layers[stack.gap].thickness}
    # Without a film between them, the gap begins at the outer medium.
    return found | ({"film": stack.layers[stack.gap - 1].thickness} if stack.gap > 1 else {})
