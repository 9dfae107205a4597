"""A frequency that falls or rises as the amplitude of a decay does."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import Dissipation


def pull(mode: Dissipation, values: Values) -> Dissipation:
    """Shift the frequency in proportion to the energy."""
    return replace(mode, pull=mode.pull + values["shift"] * np.exp(mode.level))


EFFECT = Effect(
    name="duffing_shift",
    accuracy=0.02,
    accuracy_reason="the first order in the energy; the next follows with its square",
    equation="f → f (1 + ⅜αA²), shift = ⅜αA₀²f",
    parameters=(
        ParameterSpec(
            "shift",
            "Hz",
            -1000.0,
            1000.0,
            scale="rate",
            reason="a thousand times the rate of the decay: the phase would turn so often between "
            "two points that no record followed it",
        ),
    ),
    changes={"dissipation": pull},
    source="Landau and Lifshitz, Mechanics, § 28; of decays, Polunin et al., J. Microelectromech. "
    "Syst. 25, 297 (2016)",
    limits="⅜αA₀² ≪ 1; seen only where the phase is recorded",
    sentence="the frequency follows the amplitude of the decay",
    needs=("phase",),
)
