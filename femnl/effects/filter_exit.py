"""A frequency that leaves the bandwidth of the analyser."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import Reading


def leave(reading: Reading, values: Values) -> Reading:
    """Attenuate the signal with the square of the detuning, which grows evenly."""
    pace = values["exit_rate"] / reading.bandwidth**2
    return replace(reading, gain=reading.gain * np.exp(-0.5 * pace * reading.time**2))


EFFECT = Effect(
    name="filter_exit",
    accuracy=0.1,
    accuracy_reason="a Gaussian filter and an even drift; four-pole filters differ from it by a "
    "tenth of the attenuation at 10 dB, and drifts relax",
    equation="P → P e^{−(t/T)²}, 1/T = 2√(ln 2) ḟ/B for a drift ḟ and a bandwidth B at −3 dB",
    parameters=(
        ParameterSpec(
            "exit_rate",
            "1/s^2",
            0.0,
            100.0,
            scale="per_time_square",
            reason="the filter takes e^100 of the power within the record: the mode is lost",
        ),
    ),
    changes={"reading": leave},
    source="response of a Gaussian resolution filter, Rauscher, Fundamentals of Spectrum Analysis "
    "(Rohde & Schwarz, 2001), section 4.2",
    limits="tuned at the begin of the decay; a constant detuning beside the drift adds to the rate "
    "of the decay and cannot be told from it; the drift is slow against the bandwidth",
    sentence="the frequency drifts out of the bandwidth of the analyser",
)
