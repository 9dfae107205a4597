"""A signal that comes late by the same time at all frequencies."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Signal


def delay(signal: Signal, values: Values) -> Signal:
    """Turn the signal by −2π(f − f₀)τ; what τ does at f₀ belongs to the phase of the readout."""
    turn = np.exp(-2j * np.pi * signal.detuning * values["tau"])
    return replace(signal, voltage=signal.voltage * turn)


EFFECT = Effect(
    name="group_delay",
    accuracy=0.01,
    accuracy_reason="a delay that is the same over the span",
    imitates={"response": {"fano_background": 0.51, UNKNOWN: 0.25}},
    equation="V → V e^{−2πi(f − f₀)τ}",
    parameters=(
        ParameterSpec(
            "tau",
            "s",
            -1e-4,
            1e-4,
            reason="cables delay by 5 ns/m, the electronics up to their output by a few tens of "
            "µs; what is slower is a filter that lags behind the sweep. Negative where the lock-in "
            "corrects for more than there is.",
        ),
    ),
    changes={"signal": delay},
    source="Sommer et al., arXiv:2502.19191, supplement, Duffing fit functions; τ = −dφ/dω",
    limits="exact for a delay that is the same at all frequencies of the sweeps. To first order "
    "in τ a linear mode turned so is one with a constant background (crosstalk): "
    "(f − f₀)L = −1 + i(w/2)L, L = 1/(f₀ − f + iw/2); sweeps tell them apart by the second order, "
    "(2π(f − f₀)τ)²/2, and where the mode is nonlinear",
    sentence="the signal is delayed on its way to the detector",
    shared=False,
    pointwise=True,
)
