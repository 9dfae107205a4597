"""Quality factors: what bending loses, diluted by tension, and what gas takes."""

import logging
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from femnl.core.arrays import freeze
from femnl.core.device import Model
from femnl.core.discretisation_error import remainder
from femnl.core.errors import ParameterError
from femnl.core.modes import STEADY, Modes
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.gas import free_molecular_loss, mean_free_path
from femnl.mechanics.modes.dilution import bending_shares, dilution, refuse_without_bending
from femnl.mechanics.modes.operators import mass_matrix

Array = NDArray[np.float64]

SHORT = 0.1
"""Mean free path over the length of the film below which gas is no longer single molecules."""


@dataclass(frozen=True)
class Quality:
    """Quality factors of modes, 1/Q = 1/(Q_int D) + 1/Q_gas.

    With layers 1/Q = Σ sᵢ/Qᵢ + 1/Q_gas, sᵢ the part of the energy that film and layers store as
    they bend, Σ sᵢ = 1/D.

    total, low, high (n,): Q, and its bounds for β one standard deviation less and more and for the
    discretisation error of D. intrinsic: Q_int of the film as it bends, and its two bounds.
    dilution, dilution_error (n,): D = Q/Q_bend. gas (n,): infinite in a vacuum. lost (1 + n_layers,
    n): parts of the loss of the material that are of the film and of each layer.
    """

    total: Array
    low: Array
    high: Array
    intrinsic: tuple[float, float, float]
    dilution: Array
    dilution_error: Array
    gas: Array
    lost: Array

    def __post_init__(self) -> None:
        freeze(self)


def solve_quality(modes: Modes, pressure: float = 0.0) -> Quality:
    """Return the quality factors of the modes of a film in absolute terms.

    Bending loses 2π/Q_int of its energy a cycle at the edge, at holes and in between; the energy of
    tension is without loss, so that Q = Q_int D with D of `dilution` and Q_int of
    `core.device.Loss`. Layers lose by their own quality factors, each in proportion to the energy
    that it stores as it bends. Thin gas takes 1/Q_gas of `free_molecular_loss`.

    Args: modes: with bending, of an even film. pressure: of nitrogen at room temperature on both
    sides [Pa].
    Returns: Quality. Raises: ParameterError for an uneven film, a layer without a quality factor,
        or a pressure below 0, or one at which the mean free path is below a tenth of the film.
    Valid: an upper bound, as sound that the edge radiates into the chip is left out; gas of a mean
        free path long against the film, and no wall nearby. The film's Q_int is that of bending
        about its middle, which layers move.
    Source: Villanueva and Schmid, Phys. Rev. Lett. 113, 227201 (2014); Christian, Vacuum 16, 175
        (1966). Held against closed forms by tests/physics/test_quality.py.
    """
    model = modes.domain.model
    film = model.film
    refuse_unknown_loss(model)
    if not 0 <= pressure < np.inf:
        raise ParameterError(f"pressure = {pressure:g} Pa: expected 0 or more")
    _need_free_molecules(pressure, model.outline.length)
    factor, error = dilution(modes)
    intrinsic = model.loss.intrinsic(film.thickness)
    gas = pressure * np.array([free_molecular_loss(film, f) for f in modes.frequency])
    share = 1 / factor[None]
    spread = error * share**2
    if model.layers:
        gas = gas / load_of_layers(modes)
        share, spread = _shares(modes)
    mean, low, high = (
        np.array([own, *(lamina.quality for lamina in model.layers)])[:, None] for own in intrinsic
    )
    own = share / mean
    with np.errstate(divide="ignore"):
        return Quality(
            1 / (own.sum(axis=0) + gas),
            1 / (((share + spread) / low).sum(axis=0) + gas),
            1 / ((np.maximum(share - spread, 0.0) / high).sum(axis=0) + gas),
            intrinsic,
            factor,
            error,
            1 / gas,
            own / own.sum(axis=0),
        )


def _need_free_molecules(pressure: float, length: float) -> None:
    """Warn of a mean free path that is not long against the film, and refuse a short one."""
    path = mean_free_path(pressure) if pressure > 0 else np.inf
    if path > length:
        return
    told = (
        f"pressure = {pressure:g} Pa: the mean free path of the gas, {path * 1e6:.3g} µm, is not "
        f"long against the film, {length * 1e6:.4g} µm"
    )
    if path < SHORT * length:
        most = mean_free_path(1.0) / length
        raise ParameterError(
            f"{told}, and Q_gas is that of single molecules; give a pressure below {most:.2g} Pa, "
            "or none"
        )
    logging.getLogger("femnl").warning("%s, and Q_gas is that of single molecules", told)


def refuse_unknown_loss(model: Model) -> None:
    """Refuse a device whose Q the file leaves open, before modes are solved for it.

    Raises: ParameterError for an uneven film, one without bending, and a layer without a quality
    factor.
    """
    refuse_without_bending(model)
    film = model.film
    for number, lamina in enumerate(model.layers, start=1):
        if lamina.quality is None:
            raise ParameterError(
                f"{model.name}: [layers] {number} {lamina.name}: Q needs its quality_factor; write "
                "that of its material as it bends, or ask for the dissipation dilution alone"
            )
    uneven = film.taper > 0 or any(film.gradient)
    if uneven or (model.overhang is not None and model.overhang.film != film):
        raise ParameterError(
            f"{model.name}: Q_int depends on the thickness, and this film is uneven; ask for its "
            "dissipation dilution alone"
        )


def _shares(modes: Modes) -> tuple[Array, Array]:
    """Return `bending_shares` (1 + n_layers, n) and their discretisation errors."""
    grades = [bending_shares(grade) for grade in modes.grades]
    if len(grades) < 2:
        return grades[0], np.full(grades[0].shape, np.inf)
    errors = [
        remainder([grade[k] for grade in grades[:3]], grades[0][k], STEADY)
        for k in range(len(grades[0]))
    ]
    return grades[0], np.stack(errors)


def load_of_layers(modes: Modes) -> Array:
    """Return by what factor (n,) layers raise the inertia of each mode above that of the film."""
    domain = modes.domain
    bare = replace(domain, model=replace(domain.model, layers=()))
    alone = mass_matrix(bare, Space(domain.mesh, modes.degree))
    own = domain.copies * np.einsum("ni,ni->n", modes.shapes, (alone @ modes.shapes.T).T)
    return np.asarray(modes.effective_mass / own)
