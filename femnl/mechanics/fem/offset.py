"""How layers pull a film out of its plane."""

from collections.abc import Iterator

import numpy as np

from femnl.core.device import Model


def covers_evenly(model: Model) -> bool:
    """Whether a film has layers and is the same laminate everywhere."""
    film = model.film
    even = film.taper == 0 and not any(film.gradient)
    return bool(model.layers) and even and not any(lamina.rims for lamina in model.layers)


def ends_free(model: Model) -> bool:
    """Whether the film may turn at some edge: one that is free, or held by springs that turn."""
    free = not all(segment.clamped for segment in model.outline.segments)
    return free or model.released or bool(np.isfinite(model.clamp.rotation))


def own_moment(model: Model) -> float:
    """Return M₀ = Σ σᵢhᵢ (zᵢ − z₀) [N], the moment by length that stresses of layers leave.

    About the neutral plane z₀ = Σ hᵢzᵢEᵢ/(1 − νᵢ) / Σ hᵢEᵢ/(1 − νᵢ) of stresses that are equal in
    all directions; positive where the film turns up, towards its top. Of a film that is
    `covers_evenly`: the same everywhere, M₀ bends it from its free edges alone.
    Valid: exact where the layers share one Poisson's ratio; else where the tension is even too.
    Source: Timoshenko, J. Opt. Soc. Am. 11, 233 (1925), for two layers.
    """
    plies = list(_plies(model))
    stiffness = sum(size * biaxial for size, _, biaxial, _ in plies)
    plane = sum(size * biaxial * height for size, height, biaxial, _ in plies) / stiffness
    return float(sum(stress * size * (height - plane) for size, height, _, stress in plies))


def tension_offset(model: Model) -> float:
    """Return the height e = Σ σᵢhᵢzᵢ / Σ σᵢhᵢ [m] of the tension above the film's middle.

    Where all layers lie, before release, with its sign; 0 where no layer ends within the film or at
    a free edge. A flexible film comes to rest with its tension in one plane, so that it bends by
    about e at the rims of its layers.
    Valid: an estimate, which neglects the stiffness of bending and how the stress relaxes.
    """
    ends_within = any(lamina.rims for lamina in model.layers)
    if not model.layers or not (ends_within or ends_free(model)):
        return 0.0
    plies = list(_plies(model))
    tension = sum(stress * size for size, _, _, stress in plies)
    return float(sum(stress * size * height for size, height, _, stress in plies) / tension)


def _plies(model: Model) -> Iterator[tuple[float, float, float, float]]:
    """Thickness and height of the middle [m], E/(1 − ν) and stress [Pa] of film and layers."""
    film = model.film
    yield film.thickness, 0.0, film.young / (1 - film.poisson), film.stress
    ends = {"top": film.thickness / 2, "bottom": film.thickness / 2}
    for lamina in model.layers:
        away = ends[lamina.side] + lamina.thickness / 2
        ends[lamina.side] += lamina.thickness
        height = away if lamina.side == "top" else -away
        yield lamina.thickness, height, lamina.young / (1 - lamina.poisson), lamina.stress
