"""Sides that differ from those of the geometry by their ratio."""

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import ModalSystem


def stretch(system: ModalSystem, values: Values) -> ModalSystem:
    """Lengthen x by the factor 1 + e/2 and shorten y by the same.

    ∂x → ∂x/(1 + e/2), ∂y → ∂y(1 + e/2).
    """
    factor = (1 + values["elongation"] / 2) ** 2
    return system.stretched(0, system.stress * (1 / factor - 1), system.stress * (factor - 1))


EFFECT = Effect(
    name="aspect_ratio",
    accuracy=0.005,
    accuracy_reason="corners and walls of an etch are straight to a percent of what it adds",
    equation="Lx → Lx(1 + e/2), Ly → Ly/(1 + e/2)",
    parameters=(
        ParameterSpec(
            "elongation",
            "1",
            -0.1,
            0.1,
            reason="lithography and an etch through the wafer are true to 10 µm, a tenth of the "
            "smallest films; beyond, the base modes do not span the new ones",
        ),
    ),
    changes={"operators": stretch},
    source="membrane equation in scaled coordinates",
    limits="the bending layer at the edge does not change; in frequencies alone the same as "
    "stress_anisotropy",
    sentence="the sides are not in the ratio that the geometry says",
)
