"""One other mode, as the partner in a close pair, that moves with the driven one."""

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Motion

OTHERS = 5
PAIRED = 1e-5
"""Relative difference of two simulated frequencies up to which symmetry makes them one."""
REASON = (
    "a mode that moves more than the driven one would be taken for it, and the map posed with that"
)


def join(motion: Motion, values: Values) -> Motion:
    """Add (e + iq) (cos ψ ξ_j + sin ψ ξ_k) to the shape of the driven mode."""
    others = np.delete(np.arange(len(motion.shapes)), motion.mode)
    j = int(others[round(values["partner"]) - 1])
    partner = motion.shapes[j]
    for k in others:
        apart = abs(motion.frequencies[k] - motion.frequencies[j])
        if k != j and apart <= PAIRED * motion.frequencies[j]:
            partner = np.cos(values["turn"]) * partner + np.sin(values["turn"]) * motion.shapes[k]
            break
    share = complex(values["in_phase"], values["quadrature"])
    return motion.raised(1, motion.swing * share * partner)


EFFECT = Effect(
    name="doublet",
    accuracy=0.01,
    accuracy_reason="shapes of the film as designed",
    imitates={
        "map": {
            "mode_admixture": 1.0,
            "resonance_drift": 1.0,
            "multilayer_fringe": 0.59,
            "stage_scale": 0.56,
            "stage_rotation": 0.56,
            UNKNOWN: 0.42,
        }
    },
    equation="ξ → ξ + (e + iq) (cos ψ ξ_j + sin ψ ξ_k), j one of the five lowest other modes, k "
    "the one that symmetry gives the same frequency; ψ = 0 where there is none",
    parameters=(
        ParameterSpec(
            "partner",
            "1",
            1.0,
            OTHERS,
            strength=False,
            whole=True,
            reason="which of the other modes, in order of frequency; higher ones are several "
            "thousand linewidths away from a mode that a map shows",
        ),
        ParameterSpec(
            "turn",
            "rad",
            -0.6 * np.pi,
            0.6 * np.pi,
            strength=False,
            reason="how a pair of one frequency lies is for small imperfections to say; e and q "
            "have either sign, so that half a turn is all, and a little more spares it an end",
        ),
        ParameterSpec("in_phase", "1", -1.0, 1.0, reason=REASON),
        ParameterSpec("quadrature", "1", -1.0, 1.0, reason=REASON),
    ),
    changes={"motion": join},
    source="linear response of two modes at one drive, each of its own phase: (ω_j² − ω² + "
    "iωω_j/Q)⁻¹ of a driven damped oscillator",
    limits="linear response: the share is the same all over the map. An admixture of two modes of "
    "one frequency, of one phase, is one partner. A small one in the mode with "
    "a nodal line across the slow axis looks as a steady drift of the resonance does: shares "
    "below 0.01 leave 3σ between them on a map of 25 × 25 points and 66σ contrast",
    sentence="one other mode, as the partner of a close pair, moves along with the driven one",
)
