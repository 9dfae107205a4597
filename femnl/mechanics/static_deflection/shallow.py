"""How deep a bow may be: slopes must stay small, |∇w| ≪ 1."""

from femnl.core.device import Model
from femnl.core.errors import ParameterError

SHALLOW = 0.1
"""Of the film's length, how deep a bow may be."""
FORESEEN = 2.0
"""Of that depth, from where on a pressure is refused by the depth that is foreseen."""


def foreseen_depth(model: Model, pressure: float) -> float:
    """Return about how deep a pressure [Pa] bends a film [m], seldom more than it does.

    That of a disc as wide as the film is long: by tension p a²/4σh, by stretching alone
    0.66 a (pa/Eh)^⅓, or by bending alone p a⁴/64D, whichever is least.
    Source: Timoshenko and Woinowsky-Krieger, Theory of Plates and Shells (1959), sections 15, 97.
    """
    film = model.film
    radius = model.outline.length / 2
    size = abs(pressure)
    stiffness = film.young * film.thickness
    rigidity = stiffness * film.thickness**2 / (12 * (1 - film.poisson**2))
    depths = [0.66 * radius * (size * radius / stiffness) ** (1 / 3)]
    depths.append(size * radius**4 / (64 * rigidity))
    if film.stress > 0:
        depths.append(size * radius**2 / (4 * film.stress * film.thickness))
    return float(min(depths))


def refuse_deep(depth: float, length: float, pressure: float, margin: float = 1.0) -> None:
    """Refuse a pressure [Pa] whose bow of a depth [m] is `margin` times too deep for a length [m].

    Raises: ParameterError.
    """
    if not abs(depth) <= margin * SHALLOW * length:
        raise ParameterError(
            f"bow: {pressure:g} Pa bends a film of {length:g} m by about {abs(depth):.2g} m, where "
            f"slopes are no longer small; expected a depth of at most {SHALLOW:g} of the film, so "
            "a lower pressure"
        )
