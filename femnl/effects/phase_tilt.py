"""A wafer that is tilted against the film."""

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Motion

REASON = (
    "0.4 µm over a film of 270 µm, an eighth of a gap of 3 µm: sacrificial layers and etched gaps "
    "are even to a few per cent over a chip, so that a steeper wedge is a film torn off"
)


def tilt(motion: Motion, values: Values) -> Motion:
    """Widen the gap by sx x + sy y."""
    return motion.shifted(values["slope_x"] * motion.x + values["slope_y"] * motion.y)


EFFECT = Effect(
    name="phase_tilt",
    accuracy=0.01,
    accuracy_reason="a plane; a chip that is glued is bent too",
    imitates={"map": {UNKNOWN: 0.38}},
    equation="θ → θ + 4π(sx x + sy y)/λ",
    parameters=(
        ParameterSpec("slope_x", "1", -1.5e-3, 1.5e-3, reason=REASON),
        ParameterSpec("slope_y", "1", -1.5e-3, 1.5e-3, reason=REASON),
    ),
    changes={"motion": tilt},
    source="gap d(x, y) linear in x and y, θ = 4πd/λ: in metres the same at every wavelength",
    limits="film and wafer flat",
    sentence="the gap under the film is wedge-shaped, so that the working point of the fringe "
    "varies over the map",
)
