"""Gas in the gap between film and wafer, compressed faster than it can leave."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.core.stages import Lines, ModalSystem, Points


def stiffen(system: ModalSystem, values: Values) -> ModalSystem:
    """Add np/d per area to K, less of it the faster the gas leaves."""
    square = np.diag(system.stiffness) / np.diag(system.mass)
    slow = square * _times(square, values) ** 2
    area = np.diag(system.mass) / (system.film.density * system.film.thickness)
    spring = np.diag(values["pressure"] / system.gap * area * slow / (1 + slow))
    return replace(system, stiffness=system.stiffness + spring, unbent=system.unbent + spring)


def damp(lines: Lines, values: Values) -> Lines:
    """Add the loss of the gas that leaves and comes back."""
    if lines.film is None or not len(lines.loss):
        return lines
    omega = 2 * np.pi * lines.frequency
    turn = omega * _times(omega**2, values)
    inertia = lines.film.density * lines.film.thickness * lines.gap
    more = values["pressure"] / (inertia * omega**2) * turn / (1 + turn**2)
    return replace(lines, loss=lines.loss + more)


def stiffen_points(points: Points, values: Values) -> Points:
    """Both for one mode against pressure, where np is that at the highest one."""
    film = points.film
    pressure = points.control["pressure"]
    if film is None:
        return points
    omega = 2 * np.pi * points.frequency
    turn = omega * values["escape_time"]
    inertia = film.density * film.thickness * points.gap
    spring = values["pressure"] * pressure / pressure.max() / (inertia * omega**2)
    loss = 1 / points.quality_factor + spring * turn / (1 + turn**2)
    return replace(
        points,
        frequency=points.frequency * np.sqrt(1 + spring * turn**2 / (1 + turn**2)),
        quality_factor=1 / loss,
    )


def _times(square: Array, values: Values) -> Array:
    """Return the escape time 1/(D k²) of each mode, from that of the lowest."""
    return np.asarray(values["escape_time"] * square.min(axis=-1, keepdims=True) / square)


EFFECT = Effect(
    name="trapped_gas",
    accuracy=0.1,
    accuracy_reason="one time constant for the gas under each mode",
    imitates={
        "series": {"gas_damping": 0.98, UNKNOWN: 0.02},
        "spectrum": {"gas_damping": 1.0, UNKNOWN: 0.72},
    },
    equation="ω² → ω² + (np/ρhd) (ωτ)²/(1 + (ωτ)²), 1/Q → 1/Q + (np/ρhdω²) ωτ/(1 + (ωτ)²), "
    "τ = 1/(Dk²) the time in which gas leaves from under a mode, d the gap",
    parameters=(
        ParameterSpec(
            "pressure",
            "Pa",
            0.0,
            1.7,
            scale="highest_pressure",
            reason="between n = 1, isothermal, and n = 5/3, adiabatic with one atom a molecule",
        ),
        ParameterSpec(
            "escape_time",
            "s",
            0.27,
            3e4,
            strength=False,
            log=True,
            scale="crossing_time",
            reason="no gas leaves faster than hydrogen that flies straight out, √(2/28) of what "
            "nitrogen takes (Bao 2002); where ωτ exceeds 1e4 neither f nor Q changes any more",
        ),
    ),
    changes={"operators": stiffen, "frequencies": damp, "points": stiffen_points},
    source="linearised Reynolds equation with an open rim: Blech, J. Lubr. Technol. 105, 615 "
    "(1983); gas that cannot leave: p changes by −np w/d, so that ω² gains np/(ρhd); compared with "
    "measurements by Andrews, Harris & Turner, Sens. Actuators A 36, 79 (1993)",
    limits="gap short against the wavelength, kd < 0.1 for 1 %; exact for membrane modes with an "
    "open rim; D without change from mode to mode and with pressure, as in free molecular flow; a "
    "closed rim lets modes of no volume keep their gas alike",
    sentence="gas trapped between film and wafer stiffens the film",
    needs=("gap", "highest_pressure"),
    one_material=True,
    pointwise=True,
)
