"""The fringe, at amplitudes where it is no longer straight."""

from dataclasses import replace

import numpy as np
from scipy.special import j1

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Signal


def bend(signal: Signal, values: Values) -> Signal:
    """Multiply the signal by 2J₁(z)/z, z = 4π|ξ|A/λ with the ξ of each place, times √s."""
    reach = np.sqrt(values["share"]) * np.abs(signal.shape)
    z = reach * 4 * np.pi * signal.amplitude / signal.wavelength
    small = np.where(z > 1e-4, z, 1.0)
    return replace(
        signal, voltage=signal.voltage * np.where(z > 1e-4, 2 * j1(small) / small, 1 - z**2 / 8)
    )


EFFECT = Effect(
    name="nonlinear_readout",
    accuracy=0.03,
    accuracy_reason="a sinusoidal fringe at its steepest point",
    imitates={
        "response": {"one_sided_saturation": 0.97, "detector_saturation": 0.97, UNKNOWN: 0.07}
    },
    equation="V → V 2J₁(z)/z, z² = s (4π ξ(x_p) A/λ)² at each place x_p; ξ = 1 where x, y are not "
    "recorded",
    parameters=(
        ParameterSpec(
            "share",
            "1",
            0.0,
            2.0,
            reason="|ξ| ≤ 1 by its definition, so that s is at most what metres are unsure by: "
            "A² ∝ 1/α, α known to 20 % (one sd), 2 at five sd",
        ),
    ),
    changes={"signal": bend},
    source="Sommer et al., arXiv:2502.19191, S7; Dolleman et al., arXiv:1711.06056",
    limits="one cosine, whose J₁ is exact. With x, y, s is 1 within 20 % where α is as simulated "
    "and places are right; a place wrong by d changes ξ² by 2ξ|∇ξ|d, 2 % at 1 µm on a flank of "
    "(2,2) of 270 µm. Without x, y, s = ξ² at the spot",
    sentence="the fringe is not straight over the motion",
    needs=("wavelength",),
    shared=False,
    pointwise=True,
)
