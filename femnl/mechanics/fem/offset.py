"""How far layers move the tension out of the film's middle."""

from femnl.core.device import Model


def tension_offset(model: Model) -> float:
    """Return the height e = Σ σᵢhᵢzᵢ / Σ σᵢhᵢ [m] of the tension above the film's middle.

    Where all layers lie, before release, with its sign; 0 where no layer ends within the film or at
    a free edge. A flexible film comes to rest with its tension in one plane, so that it bends by
    about e at the rims of its layers.
    Valid: an estimate, which neglects the stiffness of bending and how the stress relaxes.
    """
    ends_within = any(lamina.rims for lamina in model.layers)
    free = not all(segment.clamped for segment in model.outline.segments)
    if not model.layers or not (ends_within or free or model.released):
        return 0.0
    film = model.film
    tension = film.stress * film.thickness
    moment = 0.0
    ends = {"top": film.thickness / 2, "bottom": film.thickness / 2}
    for lamina in model.layers:
        away = ends[lamina.side] + lamina.thickness / 2
        ends[lamina.side] += lamina.thickness
        pull = lamina.stress * lamina.thickness
        tension += pull
        moment += pull * (away if lamina.side == "top" else -away)
    return moment / tension
