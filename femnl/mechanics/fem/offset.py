"""How layers pull a film out of its plane."""

import logging
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from femnl.core.device import Model


@dataclass(frozen=True)
class Ply:
    """Film or layer as a part of a laminate.

    thickness and height of its middle above that of the film [m], Young's modulus [Pa], Poisson's
    ratio, density [kg/m³], stress [Pa].
    """

    thickness: float
    height: float
    young: float
    poisson: float
    density: float
    stress: float

    @property
    def biaxial(self) -> float:
        """E/(1 − ν) [Pa], of strains that are equal in all directions."""
        return self.young / (1 - self.poisson)


def covers_evenly(model: Model) -> bool:
    """Whether a film has layers and is the same laminate everywhere."""
    film = model.film
    even = film.taper == 0 and not any(film.gradient)
    return bool(model.layers) and even and not layers_end_within(model)


def layers_end_within(model: Model) -> bool:
    """Whether a layer has a shape, so that it does not cover the whole film."""
    return any(lamina.rims for lamina in model.layers)


def ends_free(model: Model) -> bool:
    """Whether the film may turn at some edge: one that is free, or held by springs that turn."""
    free = not all(segment.clamped for segment in model.outline.segments)
    return free or model.released or bool(np.isfinite(model.clamp.rotation))


def own_moment(model: Model) -> float:
    """Return M₀ = Σ σᵢhᵢ (zᵢ − z₀) [N], the moment by length that stresses of layers leave.

    It is taken about the neutral plane z₀ = Σ hᵢzᵢEᵢ/(1 − νᵢ) / Σ hᵢEᵢ/(1 − νᵢ) of stresses that
    are equal in all directions, and is positive where the film turns up, towards its top. In a film
    that is `covers_evenly` it is the same everywhere, and bends the film from its free edges alone.
    Valid: exact where the layers share one Poisson's ratio; else where the tension is even too.
    Source: Timoshenko, J. Opt. Soc. Am. 11, 233 (1925), for two layers.
    """
    all_plies = list(plies(model))
    stiffness = sum(ply.thickness * ply.biaxial for ply in all_plies)
    plane = sum(ply.thickness * ply.biaxial * ply.height for ply in all_plies) / stiffness
    return float(sum(ply.stress * ply.thickness * (ply.height - plane) for ply in all_plies))


def tension_offset(model: Model) -> float:
    """Return the height e = Σ σᵢhᵢzᵢ / Σ σᵢhᵢ [m] of the tension above the film's middle.

    The sums run over film and layers as they are where all layers lie, with the stresses before
    release. e is 0 where no layer ends within the film or at a free edge. A flexible film comes to
    rest with its tension in one plane, so that it bends by about e at the rims of its layers.
    Valid: an estimate, which neglects the stiffness of bending and how the stress relaxes.
    """
    if not model.layers or not (layers_end_within(model) or ends_free(model)):
        return 0.0
    all_plies = list(plies(model))
    tension = sum(ply.stress * ply.thickness for ply in all_plies)
    return float(sum(ply.stress * ply.thickness * ply.height for ply in all_plies) / tension)


def plies(model: Model) -> Iterator[Ply]:
    """The film, and its layers as if they lay on top of each other everywhere."""
    film = model.film
    yield Ply(film.thickness, 0.0, film.young, film.poisson, film.density, film.stress)
    ends = {"top": film.thickness / 2, "bottom": film.thickness / 2}
    for lamina in model.layers:
        away = ends[lamina.side] + lamina.thickness / 2
        ends[lamina.side] += lamina.thickness
        height = away if lamina.side == "top" else -away
        yield Ply(
            lamina.thickness,
            height,
            lamina.young,
            lamina.poisson,
            lamina.density,
            lamina.stress,
        )


def say_what_bends(model: Model) -> None:
    """Say how far layers bend the film at rest, which its modes are solved without."""
    if covers_evenly(model):
        if model.bending and ends_free(model):
            logging.getLogger("femnl").warning(
                "%s: the stresses of its layers bend the film at rest, from its free edges and by "
                "a moment of %.2g N; modes are those of the flat film, and a bow by its layers "
                "(--bow layers) has those of the bent one",
                model.name,
                own_moment(model),
            )
        return
    offset = tension_offset(model)
    if offset != 0:
        logging.getLogger("femnl").warning(
            "%s: the stresses of its layers bend the film at rest, by about %.2g nm, %.2g of its "
            "thickness; modes are those of the flat film, and a bow by its layers (--bow layers) "
            "has those of the bent one",
            model.name,
            abs(offset) * 1e9,
            abs(offset) / model.film.thickness,
        )
