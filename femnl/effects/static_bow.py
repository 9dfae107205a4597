"""A film that is bent at rest."""

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Motion


def bow(motion: Motion, values: Values) -> Motion:
    """Move the film by b ξ₁ at rest, ξ₁ the fundamental shape."""
    return motion.shifted(values["depth"] * motion.shapes[0])


EFFECT = Effect(
    name="static_bow",
    accuracy=0.05,
    accuracy_reason="a bow of the shape of the lowest mode; pressure and stress bow otherwise",
    imitates={"map": {"quadratic_stiffness": 0.85, UNKNOWN: 0.2}},
    equation="θ → θ + 4πb ξ₁/λ",
    parameters=(
        ParameterSpec(
            "depth",
            "m",
            -3e-7,
            3e-7,
            reason="a whole turn of θ in the middle at 633 nm; under 1.1 GPa a bow of 0.3 µm over "
            "270 µm takes 11 kPa, w = 0.0737 pa²/(σh), more than charges or a trapped gas give",
        ),
    ),
    changes={"motion": bow},
    source="static deflection b ξ₁, θ = 4πb/λ: in metres the same at every wavelength",
    limits="the shape of the fundamental mode; that of a uniform pressure differs from it by up to "
    "12 % of its depth",
    sentence="the film is bent at rest, so that the working point of the fringe follows its shape",
)
