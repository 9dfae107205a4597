"""The fringe, at amplitudes where it is no longer straight."""

from dataclasses import replace

import numpy as np
from scipy.special import j1

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import Signal


def bend(signal: Signal, values: Values) -> Signal:
    """Multiply the signal by 2J₁(z)/z, z = s 4πA/λ."""
    z = np.sqrt(values["share"]) * 4 * np.pi * signal.amplitude / signal.wavelength
    small = np.where(z > 1e-4, z, 1.0)
    return replace(
        signal, voltage=signal.voltage * np.where(z > 1e-4, 2 * j1(small) / small, 1 - z**2 / 8)
    )


EFFECT = Effect(
    name="nonlinear_readout",
    equation="V → V 2J₁(z)/z, z² = s (4πA/λ)²",
    parameters=(ParameterSpec("share", "1", 0.0, 20.0),),
    changes={"signal": bend},
    source="Sommer et al., arXiv:2502.19191, S7",
    limits="one cosine; s = ξ² at the spot where α is known",
    sentence="the fringe is not straight over the motion",
    needs=("wavelength",),
    shared=False,
)
