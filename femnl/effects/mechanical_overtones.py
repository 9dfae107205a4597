"""Motion at multiples of the drive."""

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Motion

REASON = (
    "about a third of the largest motion whose fringe can be read, λ/2: an overtone of that size "
    "is a motion of its own, which bends the resonance (arXiv:1902.01270)"
)


def sing(motion: Motion, values: Values) -> Motion:
    """Add U_n ξ_j at nω.

    ξ_j is the mode whose frequency is nearest to n times that of the driven one.

    Phases follow those of the driven motion, and so does the size: U_n is that at the largest swing
    and falls as its n-th power.
    """
    largest = np.abs(motion.swing).max()
    turn = motion.swing / largest if largest else motion.swing
    for n in (2, 3):
        near = int(np.argmin(np.abs(motion.frequencies - n * motion.frequencies[motion.mode])))
        motion = motion.raised(
            n, (values[f"cos{n}"] - 1j * values[f"sin{n}"]) * turn**n * motion.shapes[near]
        )
    return motion


EFFECT = Effect(
    name="mechanical_overtones",
    accuracy=0.03,
    accuracy_reason="overtones that follow the motion as its power",
    imitates={
        "map": {UNKNOWN: 0.03},
        "trace": {"multilayer_fringe": 0.6, "trigger_jitter": 0.57, UNKNOWN: 0.01},
    },
    equation="u → u + Σ_n ξ_j (a_n cos nτ + b_n sin nτ), n = 2, 3, τ the phase of the motion",
    parameters=tuple(
        ParameterSpec(f"{part}{n}", "m", -1e-7, 1e-7, reason=REASON)
        for n in (2, 3)
        for part in ("cos", "sin")
    ),
    changes={"motion": sing},
    source="modes near multiples of the drive that the nonlinearity of the driven one pushes; "
    "reported as overtones of membranes by Yang et al., arXiv:1902.01270",
    limits="one mode for each overtone, the one nearest in frequency",
    sentence="the film itself moves at multiples of the drive",
    couples_blocks=True,  # U_n is that at the largest swing of all
)
