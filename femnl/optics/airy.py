"""Overtones of a stack's fringe in closed form, for plane waves and for a focused beam.

The light that goes m times through the gap leaves the stack with A_m = t t′ r_w (r_b r_w)^{m−1},
so that R = |Σ_m A_m e^{−imφ}|² is a geometric series too. Time runs as exp(+iωt), φ = 4πd/λ.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from femnl.core.device import Stack
from femnl.core.readout import Array, ComplexArray
from femnl.optics.fringe import index_of

FAINT = 1e-8
"""Overtones below this part of the first are left out: no map can show them."""


@dataclass(frozen=True)
class GeometricFringe:
    """R = constant + Re Σ_{k≥1} first · ratio^{k−1} e^{ikφ} for a gap of φ = 4πd/λ.

    Overtones of the fringe of a film over a wafer fall by the same complex ratio each.
    """

    first: complex
    ratio: complex

    def coefficients(self, gap: float, wavelength: float) -> ComplexArray:
        """Return c_k/|c₁| from k = 0 for a gap [m]; c₀ = 0, which no harmonic shows."""
        count = 2 + int(np.log(FAINT) / np.log(np.clip(abs(self.ratio), FAINT, 0.999)))
        k = np.arange(count)
        turn = np.exp(4j * np.pi / wavelength * gap * k)
        unit = self.first / abs(self.first)
        series = unit * np.power(self.ratio, np.maximum(k - 1, 0)) * turn
        return np.asarray(np.where(k == 0, 0, series))


class _Side(NamedTuple):
    """Reflection of layers seen from above and from below, and transmission there and back."""

    above: complex
    below: complex
    through: complex


def geometric_fringe(
    stack: Stack, wavelength: float, thickness: float, index_scale: float = 1.0
) -> GeometricFringe:
    """Return the fringe of a stack whose film has another thickness and another index.

    Args: stack: layers with the gap; the film is the layer above the gap. wavelength: λ [m].
    thickness: of the film [m]. index_scale: factor of the film's index.
    Valid: plane waves at normal incidence, coherent layers, a gap of index 1 without loss.
    Source: Born & Wolf, Principles of Optics, 7th ed., sections 1.6.2 and 7.6 (Airy's sum).
    """
    n = [index_of(layer, wavelength) for layer in stack.layers]
    film = stack.gap - 1
    n[film] *= index_scale
    h = [layer.thickness for layer in stack.layers]
    h[film] = thickness
    gap = stack.gap
    k = 2 * np.pi / wavelength
    upper = _side(n[0], n[1:gap], k * np.array(h[1:gap]), n[gap])
    lower = _side(n[gap], n[gap + 1 : -1], k * np.array(h[gap + 1 : -1]), n[-1])
    ratio = upper.below * lower.above
    entered = upper.through * lower.above
    first = 2 * (np.conj(upper.above) * entered + abs(entered) ** 2 * ratio / (1 - abs(ratio) ** 2))
    return GeometricFringe(complex(np.conj(first)), complex(np.conj(ratio)))


def _side(before: complex, inner: list[complex], depth: Array, after: complex) -> _Side:
    """Return what layers between two media do, by characteristic matrices.

    Args: before, after: indices of the media. inner: those of the layers. depth: 2πh/λ of each.
    """
    whole = np.eye(2, dtype=complex)
    for index, size in zip(inner, depth, strict=True):
        c = np.cos(index * size)
        s = 1j * np.sin(index * size)
        whole = whole @ np.array([[c, s / index], [index * s, c]])
    a = before * whole[0, 0]
    b = before * after * whole[0, 1]
    d = after * whole[1, 1]
    total = a + b + whole[1, 0] + d
    return _Side(
        complex((a + b - whole[1, 0] - d) / total),
        complex((d + b - whole[1, 0] - a) / total),
        complex(4 * before * after / total**2),
    )


def focused(
    coefficients: ComplexArray, gap: float, wavelength: float, aperture_square: float
) -> tuple[ComplexArray, float]:
    """Return the coefficients c_k that a focused beam sees, over |c₁|, and the period it sees.

    A Gaussian beam is a sum of plane waves at angles ϑ of the power e^{−2ϑ²/NA²}. Each reflects by
    itself, and the detector adds up power: the mean of e^{ikφ cos ϑ} over angles is
    e^{ikφ}/(1 + ikd/z_R), which is also the overlap of the beam with itself after the further way
    2kd. Its slope in d shortens the phase that motion adds, to first order by the factor 1 − NA²/4.

    Args: coefficients: c_k of plane waves from k = 0. gap: d [m]. wavelength: λ [m].
    aperture_square: NA² = λ/(π z_R), NA the half angle at which the intensity is 1/e².
    Returns: c_k, and the wavelength [m] of plane waves whose fringe has the same period.
    Valid: paraxial, NA ≤ 0.2; layers of the stack thin against z_R. Source: A. E. Siegman, Lasers
    (1986), ch. 17 (z_R = πw₀²/λ, Gouy's phase); K. Creath, Appl. Opt. 28, 3333 (1989) (the fringe
    spacing under an aperture).
    """
    depth = np.pi * gap * aperture_square / wavelength
    seen = coefficients / (1 + 1j * depth * np.arange(len(coefficients)))
    shorter = 1 - aperture_square / 4 / (1 + depth**2)
    return seen / abs(seen[1]), wavelength / shorter


def stack_scales(stack: Stack | None) -> dict[str, float]:
    """Return the thicknesses [m] of gap and film, as scales of parameters, where there are any."""
    if stack is None:
        return {}
    found = {"stack": stack.layers[stack.gap].thickness}
    # Without a film between them, the gap begins at the outer medium.
    return found | ({"film": stack.layers[stack.gap - 1].thickness} if stack.gap > 1 else {})
