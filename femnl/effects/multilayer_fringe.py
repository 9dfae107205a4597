"""The fringe of the whole optical stack instead of one cosine."""

from dataclasses import replace
from functools import cache

import numpy as np

from femnl.core.device import Stack
from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.readout import ComplexArray
from femnl.core.stages import Fringe
from femnl.optics.fringe import MultilayerFringe


@cache
def _series(stack: Stack, wavelength: float) -> ComplexArray:
    """Fourier coefficients of R for a gap of zero thickness, scaled to |c₁| = 1.

    a gap d only turns c_k by k·4πd/λ.
    """
    series = MultilayerFringe(stack, wavelength).fourier.coefficients
    gap = stack.layers[stack.gap].thickness
    unturned = series * np.exp(-4j * np.pi / wavelength * gap * np.arange(len(series)))
    return np.asarray(unturned / abs(unturned[1]))


def reflect(fringe: Fringe, values: Values) -> Fringe:
    """Put the reflection of the stack with the given gap in place of the cosine."""
    if fringe.stack is None:
        return fringe
    series = _series(fringe.stack, fringe.wavelength)
    turn = np.exp(4j * np.pi / fringe.wavelength * values["gap"] * np.arange(len(series)))
    return replace(fringe, coefficients=series * turn)


EFFECT = Effect(
    name="multilayer_fringe",
    equation="f(u) = R(gap + u) of the stack, by transfer matrices",
    parameters=(ParameterSpec("gap", "m", 0.94, 1.06, strength=False, scale="stack"),),
    changes={"fringe": reflect},
    source="Byrnes, arXiv:1603.02720 (tmm); Sommer et al., arXiv:2502.19191, S6",
    limits="plane waves; the gap is known modulo half a wavelength, and which way the film "
    "moves is taken from the "
    "drive's phase",
    sentence="the fringe is the reflection of the whole optical stack and not one cosine",
    needs=("stack",),
    replaces=("theta",),
)
