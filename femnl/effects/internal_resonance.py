"""A mode near a multiple of the drive, to which the driven one loses energy."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Oscillator


def couple(mode: Oscillator, values: Values) -> Oscillator:
    """Let a second mode, driven at p times the drive, act back on the first.

    It is driven by the p-th power of the first: Π = −g²/(f_j/p − f + iw_j/2).

    Its equation at pf is B p(f_j/p − f + iw_j/2) ∝ A^p, and the force back on the first is ∝
    A*^{p−1} B.
    """
    if np.all(values["coupling_square"] == 0):
        return mode
    crossing = mode.middle + values["offset"]
    pull = -values["coupling_square"] / (crossing - mode.driven + 0.5j * values["width"])
    return replace(mode, pull=mode.pull + pull, order=values["order"])


EFFECT = Effect(
    name="internal_resonance",
    accuracy=0.05,
    accuracy_reason="one partner, of which the first order in the detuning is kept",
    imitates={
        "response": {
            "nonlinear_damping": 1.0,
            "nonlinear_readout": 1.0,
            "quintic_stiffness": 0.99,
            "one_sided_saturation": 0.9,
            "drive_compression": 0.89,
            "detector_saturation": 0.62,
            UNKNOWN: 0.36,
        }
    },
    equation="f₀ → f₀ − g² (A/A_s)^{2(p−1)} / (f_j/p − f + iw/2), p = 2, 3; ⅜αf₀A_s² = linewidth; "
    "w that of the second mode over p",
    parameters=(
        ParameterSpec(
            "coupling_square",
            "Hz^2",
            0.0,
            100.0,
            scale="linewidth_square",
            reason="g up to ten linewidths at the amplitude that stiffens the mode by one: with "
            "more, the two modes are one pair that splits, and the second does not follow",
        ),
        ParameterSpec(
            "offset",
            "Hz",
            -1.0,
            1.0,
            strength=False,
            scale="moving",
            reason="farther from the drives that move the mode strongly a second mode only "
            "stiffens it; it may itself end the strong motion, and lie half their range beyond",
        ),
        ParameterSpec(
            "width",
            "Hz",
            1e-3,
            5.0,
            strength=False,
            log=True,
            scale="linewidth",
            reason="a second mode whose w/p is a thousandth of the linewidth has a thousand times "
            "the Q of the first; what is wider than five linewidths is nonlinear damping. That of "
            "arXiv:2502.19191, (2,2) at twice (1,1), has 0.015",
        ),
        ParameterSpec(
            "order",
            "1",
            1.5,
            3.5,
            strength=False,
            whole=True,
            reason="quadratic and cubic forces; those of higher order are weaker by (A/L)²",
        ),
    ),
    changes={"oscillator": couple},
    source="Nayfeh & Mook (1979), section 6.5, the second mode slaved: averaging of q₁²q₂ (p = "
    "2) and q₁³q₂ (p = 3)",
    limits="a steady second mode that follows the first, 15 % of the wiggle against harmonic "
    "balance of both; f_j/p lies among the drives that move the mode most, from whose middle the "
    "offset counts. A partner narrower than the distance of the points has a width known only "
    "from above",
    sentence="the driven mode gives energy to another one near a multiple of its frequency",
    pointwise=True,
)
