"""Gas that moves with the film."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.core.stages import ModalSystem, Points


def load(system: ModalSystem, values: Values) -> ModalSystem:
    """Add the mass of the gas that each pair of modes moves, above the film and in the gap."""
    own = system.squared
    # Of a film that layers load, k² = ω²m/(T∫ξ²)
    loaded = np.diag(system.mass) / (system.film.density * system.film.thickness * own)
    wavenumber = system.wavenumber * np.sqrt(loaded)
    waves = np.diag(own / wavenumber)
    free = system.airload if len(system.airload) else waves
    below = waves / np.tanh(wavenumber * system.gap) if np.isfinite(system.gap) else free
    return replace(system, mass=system.mass + values["gas_density"] * (free + below))


def load_points(points: Points, values: Values) -> Points:
    """The same against pressure for a plane wave, where the density is that at the highest one."""
    film = points.film
    pressure = points.control["pressure"]
    if film is None:
        return points
    wavenumber = 2 * np.pi * points.frequency / np.sqrt(film.stress / film.density)
    depth: Array = (1 + 1 / np.tanh(wavenumber * points.gap)) / wavenumber
    share = values["gas_density"] * depth / (film.density * film.thickness)
    square = 1 + share * pressure / pressure.max()
    return replace(points, frequency=points.frequency / np.sqrt(square))


EFFECT = Effect(
    name="gas_loading",
    accuracy=0.03,
    accuracy_reason="no viscosity, holes count as film; Lamb's term is exact for an open rim",
    imitates={
        "series": {UNKNOWN: 0.1},
        "spectrum": {
            "bending_stiffness": 0.64,
            "hole_dispersion": 0.62,
            "yielding_edge": 0.56,
            UNKNOWN: 0.45,
        },
    },
    equation="M → M + ρ_g (∫∫ξξ′/(2πr) + ∫ξ² coth(kd)/k), d the gap to the wafer; with no wafer "
    "twice the first term",
    parameters=(
        ParameterSpec(
            "gas_density",
            "kg/m³",
            0.0,
            6.5e-5,
            scale="highest_pressure",
            reason="no gas of usual use is heavier than SF6, 5.95e-5 kg/m³ a pascal at 295 K; air "
            "has 1.2e-5 (ideal gas law); 1.05 bar where no pressure is recorded",
        ),
    ),
    changes={"operators": load, "points": load_points},
    source="potential flow: over a baffle Rayleigh's integral of −ẇ/2πr over the film, which is "
    "1/k of a wave; between film and wall cosh k(z + d), whose ratio to its slope at the film is "
    "coth(kd)/k",
    limits="gas without viscosity or sound: waves on the film slower than in the gas, "
    "(c/c_gas)² ≪ 1, and a mean free path short against the gap; a film faster than sound has its "
    "gas stiffened in the gap (trapped_gas). Open rim of the gap, which makes its term exact; "
    "free side 1e-3 for a film in a rigid plane; holes count as film. A series takes the free "
    "side of a plane wave, 46 % too little for the mode (1,1), which is 5 % of the whole at "
    "kd = 0.05",
    sentence="gas moves with the film and loads the low modes most",
    needs=("highest_pressure",),
)
