"""A film that is bent at rest."""

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import Motion


def bow(motion: Motion, values: Values) -> Motion:
    """Move the film by b ξ₁ at rest, ξ₁ the fundamental shape."""
    return motion.shifted(values["depth"] * motion.shapes[0])


EFFECT = Effect(
    name="static_bow",
    equation="θ → θ + 4πb ξ₁/λ",
    parameters=(ParameterSpec("depth", "m", -3e-7, 3e-7),),
    changes={"motion": bow},
    source="static deflection b ξ₁, θ = 4πb/λ: in metres the same at every wavelength",
    limits="a bow of the shape of the fundamental mode",
    sentence="the film is bent at rest, so that the working point of the fringe follows its shape",
)
