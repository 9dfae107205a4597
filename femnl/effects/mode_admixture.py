"""Other modes that move with the driven one."""

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Motion

OTHERS = 5
"""Other modes: four would part the pair of (1,3) and (3,1)."""
REASON = (
    "a mode that moves more than the driven one would be taken for it, and the map posed with that"
)


def mix(motion: Motion, values: Values) -> Motion:
    """Add (e_j + iq_j) ξ_j to the shape of the driven mode."""
    others = [j for j in range(len(motion.shapes)) if j != motion.mode][:OTHERS]
    added = np.zeros(len(motion.x), complex)
    for i, j in enumerate(others, 1):
        added += complex(values[f"e{i}"], values[f"q{i}"]) * motion.shapes[j]
    return motion.raised(1, motion.swing * added)


EFFECT = Effect(
    name="mode_admixture",
    accuracy=0.02,
    accuracy_reason="five modes; higher ones follow with 1/(f² − f_j²)",
    imitates={
        "map": {
            "doublet": 1.0,
            "resonance_drift": 1.0,
            "multilayer_fringe": 0.59,
            "stage_rotation": 0.58,
            "stage_scale": 0.56,
            UNKNOWN: 0.68,
        }
    },
    equation="ξ → ξ + Σ (e_j + iq_j) ξ_j, over the five lowest other modes",
    parameters=tuple(
        ParameterSpec(f"{part}{i}", "1", -1.0, 1.0, reason=REASON)
        for part in "eq"
        for i in range(1, OTHERS + 1)
    ),
    changes={"motion": mix},
    source="linear response of modes driven together: a mode driven at resonance lags by 90°, one "
    "far from its own moves in phase or antiphase, by (ω_j² − ω² + iωω_j/Q)⁻¹",
    limits="five lowest others, linear response: the share of each is the same all over the map",
    sentence="other modes move along with the driven one",
)
