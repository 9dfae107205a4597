"""Gas that moves with the film."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import ModalSystem, Points


def load(system: ModalSystem, values: Values) -> ModalSystem:
    """Add the areal mass 2ρ_g/k to that of the film, ρh, mode by mode."""
    share = (
        2
        * values["gas_density"]
        / (system.wavenumber * system.film.density * system.film.thickness)
    )
    return replace(system, mass=system.mass + np.diag(share * np.diag(system.mass)))


def load_points(points: Points, values: Values) -> Points:
    """The same against pressure, where the density is that at the highest one."""
    film = points.film
    pressure = points.control.get("pressure")
    if film is None or pressure is None:
        return points
    wavenumber = 2 * np.pi * points.frequency / np.sqrt(film.stress / film.density)
    share = (
        2
        * values["gas_density"]
        * pressure
        / pressure.max()
        / (wavenumber * film.density * film.thickness)
    )
    return replace(points, frequency=points.frequency / np.sqrt(1 + share))


EFFECT = Effect(
    name="gas_loading",
    equation="ρh → ρh + 2ρ_g/k",
    parameters=(ParameterSpec("gas_density", "kg/m³", 0.0, 10.0),),
    changes={"operators": load, "points": load_points},
    source="Lamb, Proc. R. Soc. A 98, 205 (1920); potential flow on both sides",
    limits="wavelength long against the mean free path and short against that of sound; no "
    "wall near by",
    sentence="gas moves with the film and loads the low modes most",
)
