"""Which bows are modelled: slopes must stay small, |∇w| ≪ 1, and layers lie on an even film."""

import numpy as np

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


def refuse_rest(model: Model, depth: float | None, pressure: float | None) -> None:
    """Refuse a bow that `solve_static_deflection` does not model, before modes are solved for it.

    Args: as of `solve_static_deflection`. Raises: ParameterError.
    """
    if depth is not None and pressure is not None:
        raise ParameterError("bow: give either its depth in m or a pressure in Pa")
    if depth is None:
        _refuse_layers_that_end(model, pressure)
    if not np.isfinite(depth if depth is not None else pressure or 0.0):
        raise ParameterError(
            f"bow: expected a finite number, found {depth if depth is not None else pressure}"
        )
    length = model.outline.length
    if depth is not None and abs(depth) > SHALLOW * length:
        raise ParameterError(
            f"bow: depth = {depth:g} m of a film of {length:g} m is not shallow; expected at "
            f"most {SHALLOW:g} of that"
        )
    if pressure is not None:
        refuse_deep(foreseen_depth(model, pressure), length, pressure, FORESEEN)


def _refuse_layers_that_end(model: Model, pressure: float | None) -> None:
    """Refuse a rest that is not modelled, or that nothing bends."""
    if pressure is None and not model.layers:
        raise ParameterError("bow: give either its depth in m or a pressure in Pa")
    if model.layers and (model.film.taper != 0 or any(model.film.gradient)):
        raise ParameterError(
            f"{model.name}: [film]: the rest of a film with layers is solved where the film is "
            "even; leave taper and gradient out, or give the depth of a bow"
        )
    if pressure is None and not model.bending:
        raise ParameterError(
            f"{model.name}: bending = false leaves layers no lever; set bending = true"
        )
