"""A film with layers as fits and causes take it: as a film of one material, or as it is."""

import numpy as np

from femnl.core.device import Film, Model
from femnl.core.errors import ParameterError
from femnl.core.geometry_text import film_values, with_values, without_layers
from femnl.mechanics.fem.forms import plane_stress
from femnl.mechanics.fem.offset import (
    covers_evenly,
    ends_free,
    layers_end_within,
    plies,
    tension_offset,
)


def one_material(model: Model) -> Model:
    """Return the device whose film of one material moves as film and layers do together.

    It has their tension Σσᵢhᵢ, mass Σρᵢhᵢ, stiffness A = Σhᵢ Cᵢ in the plane and D − BA⁻¹B in
    bending: E/(1 − ν²)·h and E/(1 − ν²)·h³/12, of which thickness and modulus follow. A device
    without layers is returned as it is.

    Raises: ParameterError for layers with a shape, and where the film may bend at rest.
    Valid: exact where an even film is held all around, whatever the Poisson's ratios: there a plate
    knows of its rigidity alone, and the ratio is that of stretching.
    Source: Jones, Mechanics of Composite Materials (1999), section 4.2; held against the layers
    themselves by tests/physics/test_one_material.py.
    """
    if not model.layers:
        return model
    _need_even_and_flat(model)
    if model.reader is None:
        raise ParameterError(f"{model.name}: was not read from a geometry file; load one")
    film = film_values(_film(model))
    return model.reader(with_values(without_layers(model.text), film, model.name))


def keeps_layers(model: Model) -> bool:
    """Whether a spectrum is compared with the layers themselves, as one of them has a shape."""
    return layers_end_within(model)


def as_in_spectra(model: Model) -> Model:
    """Return the device with which a spectrum is compared.

    Layers with a shape stay as they lie on the film; others are taken for `one_material` with it.

    Raises: ParameterError where the film may bend at rest from its edges.
    """
    if not keeps_layers(model):
        return one_material(model)
    _need_held(model)
    return model


def told_of_layers(model: Model) -> str:
    """Return a sentence on what c, ℓ and stress mean for a film that `keeps_layers`."""
    names = ", ".join(lamina.name for lamina in model.layers)
    bent = abs(tension_offset(model))
    return (
        f"{model.name}: layers lie on the film as its geometry says ({names}); c, ℓ and stress are "
        "those of the film without them, and densities and moduli of the layers go with its own; "
        f"modes are those of the flat film, which at rest is bent by about {bent * 1e9:.2g} nm"
    )


def _need_even_and_flat(model: Model) -> None:
    for number, lamina in enumerate(model.layers, start=1):
        if lamina.rims:
            raise ParameterError(
                f"{model.name}: [layers] {number} {lamina.name}: fits and causes act on a film of "
                "one material, which stands for layers that cover the whole film only; leave the "
                "layer or its shape out, or take the geometry of an equivalent film"
            )
    if not covers_evenly(model):
        raise ParameterError(
            f"{model.name}: [film]: fits and causes act on a film of one material, which stands "
            "for layers on an even film only; leave taper and gradient out, or the layers"
        )
    _need_held(model)


def _need_held(model: Model) -> None:
    if ends_free(model):
        raise ParameterError(
            f"{model.name}: [layers]: their stresses bend the film at rest from its free or "
            "turning edges, which no fit or cause knows of; take the geometry of an equivalent film"
        )


def _film(model: Model) -> Film:
    """Return the film of one material."""
    all_plies = list(plies(model))
    membrane = np.zeros((3, 3))
    couple = np.zeros((3, 3))
    about_middle = np.zeros((3, 3))
    for ply in all_plies:
        moduli = plane_stress(ply.young, ply.poisson)
        membrane += ply.thickness * moduli
        couple += ply.thickness * ply.height * moduli
        about_middle += (ply.thickness**3 / 12 + ply.thickness * ply.height**2) * moduli
    bending = about_middle - couple @ np.linalg.solve(membrane, couple)
    poisson = float(membrane[0, 1] / membrane[0, 0])
    thickness = float(np.sqrt(12 * bending[0, 0] / membrane[0, 0]))
    return Film(
        thickness,
        float(membrane[0, 0] * (1 - poisson**2) / thickness),
        poisson,
        sum(ply.density * ply.thickness for ply in all_plies) / thickness,
        sum(ply.stress * ply.thickness for ply in all_plies) / thickness,
    )
