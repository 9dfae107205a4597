"""Other modes that move with the driven one."""

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import Motion


def mix(motion: Motion, values: Values) -> Motion:
    """Add e_j ξ_j to the shape of the driven mode, in phase with it."""
    others = [j for j in range(len(motion.shapes)) if j != motion.mode][: len(values)]
    added = sum(values[f"e{i}"] * motion.shapes[j] for i, j in enumerate(others, 1))
    return motion.raised(1, motion.swing * added)


EFFECT = Effect(
    name="mode_admixture",
    equation="ξ → ξ + Σ e_j ξ_j, over the five lowest other modes",
    # four would part the pair of (1,3) and (3,1)
    parameters=tuple(ParameterSpec(f"e{i}", "1", -0.3, 0.3) for i in range(1, 6)),
    changes={"motion": mix},
    source="coupled modes, driven together",
    limits="in phase with the driven mode; five lowest others",
    sentence="other modes move along with the driven one",
)
