"""An edge that yields in the plane of the film."""

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import ModalSystem
from femnl.core.tension import YIELDS_MOST, yielding


def yield_in_plane(system: ModalSystem, values: Values) -> ModalSystem:
    """Set the relaxed stress of a film between springs in place of that of a rigid edge.

    It is solved at a few λ, and between them a polynomial in t = λ/(λ + 0.15 R), R the film's
    reach.
    """
    return system.tensioned(yielding=yielding(values["compliance"] / system.projection.reach))


EFFECT = Effect(
    name="yielding_edge",
    accuracy=0.05,
    accuracy_reason="springs alike all around",
    imitates={
        "spectrum": {
            "aspect_ratio": 1.0,
            "stress_anisotropy": 1.0,
            "tension_gradient": 0.85,
            "compliant_clamp": 0.75,
            "added_mass": 0.61,
            UNKNOWN: 0.15,
        }
    },
    equation="∇·(σ I + C ε(u)) = 0 with S·n = −(E/λ)(u_n n + ½(1 − ν) u_t t) at the edge",
    parameters=(
        ParameterSpec(
            "compliance",
            "m",
            0.0,
            YIELDS_MOST,
            scale="reach",
            reason="λ is the width of an undercut ledge times 1 − ν², or E/σ times how far the "
            "edge is drawn in; a ledge wider than a tenth of the film is part of its outline",
        ),
    ),
    changes={"operators": yield_in_plane},
    source="plane stress between springs, as `[clamp] normal` of a geometry; a strip of width w "
    "pulls back with Eh/((1 − ν²)w) across and Gh/w along it",
    limits="an edge alike all around and at rest as deposited; even slack stays in the speed of "
    "waves. The lowest 14 of 48 modes are right to 2e-8 of the film solved anew on the same mesh, "
    "with few holes too, and to 6e-7 with shear of 0.05 beside it; with a lattice of 900 holes to "
    "1e-5",
    sentence="the edge yields in the plane of the film, which slackens it unevenly",
)
