"""Quality factors: what bending loses, diluted by tension, and what gas takes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.core.arrays import freeze
from femnl.core.errors import ParameterError
from femnl.core.mechanics import Modes
from femnl.mechanics.gas import free_molecular_loss
from femnl.mechanics.modes.dilution import dilution

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Quality:
    """Quality factors of modes, 1/Q = 1/(Q_int D) + 1/Q_gas.

    total, low, high (n,): Q, and its bounds for β one standard deviation less and more and for the
    discretisation error of D. intrinsic: Q_int of the film as it bends, and its two bounds.
    dilution, dilution_error (n,): D = Q/Q_bend. gas (n,): infinite in a vacuum.
    """

    total: Array
    low: Array
    high: Array
    intrinsic: tuple[float, float, float]
    dilution: Array
    dilution_error: Array
    gas: Array

    def __post_init__(self) -> None:
        freeze(self)


def solve_quality(modes: Modes, pressure: float = 0.0) -> Quality:
    """Quality factors of the modes of a film in absolute terms.

    Bending loses 2π/Q_int of its energy a cycle at the edge, at holes and in between; the energy of
    tension is without loss, so that Q = Q_int D with D of `dilution` and Q_int of
    `core.device.Loss`. Thin gas takes 1/Q_gas of `free_molecular_loss`.

    Args: modes: with bending, of an even film. pressure: of nitrogen at room temperature on both
    sides [Pa].
    Returns: Quality. Raises: ParameterError for an uneven film or a pressure below 0.
    Valid: an upper bound, as sound that the edge radiates into the chip is left out; gas of a mean
        free path long against the film, and no wall nearby.
    Source: Villanueva and Schmid, Phys. Rev. Lett. 113, 227201 (2014); Christian, Vacuum 16, 175
        (1966). Held against closed forms by tests/physics/test_quality.py.
    """
    model = modes.domain.model
    film = model.film
    if model.layers:
        raise ParameterError(
            f"{model.name}: [layers]: Q_int of films with layers is not modelled; ask for the "
            "dissipation dilution alone"
        )
    uneven = film.taper > 0 or any(film.gradient)
    if uneven or (model.overhang is not None and model.overhang.film != film):
        raise ParameterError(
            f"{model.name}: Q_int depends on the thickness, and this film is uneven; ask for its "
            "dissipation dilution alone"
        )
    if not 0 <= pressure < np.inf:
        raise ParameterError(f"pressure = {pressure:g} Pa: expected 0 or more")
    factor, error = dilution(modes)
    intrinsic = model.loss.intrinsic(film.thickness)
    gas = pressure * np.array([free_molecular_loss(film, f) for f in modes.frequency])
    mean, low, high = intrinsic
    share = 1 / factor
    spread = error * share**2
    with np.errstate(divide="ignore"):
        return Quality(
            1 / (share / mean + gas),
            1 / ((share + spread) / low + gas),
            1 / (np.maximum(share - spread, 0.0) / high + gas),
            intrinsic,
            factor,
            error,
            1 / gas,
        )
