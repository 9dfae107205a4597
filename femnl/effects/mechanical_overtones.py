"""Motion at multiples of the drive."""

from dataclasses import replace

import numpy as np

from femnl.types.effect import Effect, Knob, Values
from femnl.types.scene import Motion


def sing(motion: Motion, values: Values) -> Motion:
    """Add U_n ξ_j at nω, with ξ_j the mode whose frequency is nearest to n times that of the driven one; phases follow the drive's."""
    first = motion.displacement[0]
    top = int(np.argmax(np.abs(first)))
    turn = first[top] / motion.shapes[motion.mode][top]
    turn = turn / abs(turn) if turn else 1.0
    orders = [first]
    for n in (2, 3):
        near = int(np.argmin(np.abs(motion.frequencies - n * motion.frequencies[motion.mode])))
        orders.append((values[f"cos{n}"] - 1j * values[f"sin{n}"]) * turn**n * motion.shapes[near])
    return replace(motion, displacement=np.stack(orders))


EFFECT = Effect(
    name="mechanical_overtones",
    equation="u → u + Σ_n ξ_j (a_n cos nτ + b_n sin nτ), n = 2, 3, τ the phase of the motion",
    parameters=tuple(Knob(f"{part}{n}", "m", -1e-7, 1e-7) for n in (2, 3) for part in ("cos", "sin")),
    changes={"motion": sing},
    source="internal resonances, e.g. arXiv:1902.01270",
    limits="one mode for each overtone, the one nearest in frequency",
    sentence="the film itself moves at multiples of the drive",
)
