"""A lock-in whose low pass is slow beside the sweep."""

from dataclasses import replace

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Acquisition


def smear(swept: Acquisition, values: Values) -> Acquisition:
    """Let the filter keep a part of the point before."""
    return replace(swept, filtered=values["kept"], poles=values["poles"])


EFFECT = Effect(
    name="lock_in_filter",
    accuracy=0.03,
    accuracy_reason="equal poles, and a settled reading before each point",
    imitates={"response": {UNKNOWN: 0.01}},
    equation="τ ẏ_j = y_{j−1} − y_j, j = 1 … n, y_0 = V, in the order of acquisition; kept = "
    "e^{−u} Σ_{j<n} u^j/j!, u = T/τ, T the time from one point to the next",
    parameters=(
        ParameterSpec(
            "kept",
            "1",
            0.0,
            0.9,
            reason="what is left of a step after one point: at 0.9 the filter averages over ten, "
            "and the sweep shows its response instead of that of the mode",
        ),
        ParameterSpec(
            "poles",
            "1",
            0.5,
            8.5,
            strength=False,
            whole=True,
            reason="lock-ins have 1 to 8 equal poles (6 to 48 dB an octave)",
        ),
    ),
    changes={"acquisition": smear},
    source="a chain of equal RC stages, solved exactly for a signal that is constant between steps",
    limits="exact for a drive that steps from point to point, all at one pace (or that of the "
    "durations in the file), and a filter that has settled at the first point; what the mode does "
    "between two points is not seen. Poles are known only where nτ is far above T",
    sentence="the filter of the lock-in lags behind the sweep",
    needs=("direction",),
    shared=False,
    pointwise=True,
)
