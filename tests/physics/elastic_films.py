"""Films on elastic edges, and what is exactly known of them, for the tests beside this file."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import iv, ivp, jv, jvp, kv, kvp, yv, yvp

from femnl.core.device import Clamp, Model
from femnl.core.domain import Prestress
from femnl.core.modes import Modes
from femnl.device.mesh import mesh
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import cells
from femnl.mechanics.fem.stress import relaxed_stress
from femnl.mechanics.modes import solve_modes
from femnl.mechanics.prestress import solve_prestress

Array = NDArray[np.float64]
Device = Callable[..., Model]

CIRCLE = 'kind = "circle"\ndiameter = "2 m"'
SQUARE = 'kind = "square"\nside = "2 m"'
POISSON = 0.3
DENSITY = 1000.0
STRESS = 1e9
THICKNESS = 0.01
TENSION = STRESS * THICKNESS
# With the sign of Δf/k²f
BESSEL = {"J": (jv, jvp, -1), "Y": (yv, yvp, -1), "I": (iv, ivp, 1), "K": (kv, kvp, 1)}
ORDERS = (0, 1, 1, 2)


def young(layer: float) -> float:
    """E of a film with √(D/T) = `layer` [m]."""
    return 12 * (1 - POISSON**2) * STRESS * (layer / THICKNESS) ** 2


def elastic(
    device: Device, outline: str = CIRCLE, layer: float | None = None, clamp: Clamp | None = None
) -> Model:
    """A film with E = 100 GPa without bending, or with the bending length `layer`."""
    modulus = young(layer) if layer else 1e11
    film = (
        f'thickness = "1 cm"\nyoung = "{modulus:.15g} Pa"\npoisson = {POISSON}\ndensity = '
        '"1000 kg/m^3"\nstress '
        '= "1 GPa"'
    )
    return replace(
        device(outline, film=film, model=f"bending = {'true' if layer else 'false'}"),
        clamp=clamp or Clamp(),
    )


def solve(
    model: Model, count: int = 4, symmetry: str = "auto", resolution: float = 0.5, degree: int = 6
) -> Modes:
    return solve_modes(solve_prestress(mesh(model, symmetry, resolution), degree), count, degree)


def squares(modes: Modes) -> Array:
    """(ω/c)² [1/m²]."""
    return np.asarray((2 * np.pi * modes.frequency) ** 2 * DENSITY / STRESS)


def first_root(miss: Callable[[float], float], step: float = 0.02) -> float:
    """The first change of sign above zero."""
    here = 1e-3
    while miss(here) * miss(here + step) > 0:
        here += step
    return float(brentq(miss, here, here + step, xtol=1e-15, rtol=1e-14))


def traces(kind: str, order: int, wave: float, radius: float, film: tuple[float, float]) -> Array:
    """w, w', M/D and V/D at a radius of w = f(kr) cos nθ in a film of (ℓ, ν).

    V is the force per length that an edge must bear.

    M = D [w'' + ν (w'/r − n²w/r²)]; V = T w' − D [∂ᵣΔw − (1−ν) n²/r² (w' − w/r)], with T = D/ℓ².
    """
    layer, poisson = film
    value, slope, sign = BESSEL[kind]
    f = value(order, wave * radius)
    f1 = wave * slope(order, wave * radius)
    f2 = wave**2 * slope(order, wave * radius, 2)
    moment = f2 + poisson * (f1 / radius - order**2 * f / radius**2)
    force = (
        f1 / layer**2
        - sign * wave**2 * f1
        + (1 - poisson) * order**2 / radius**2 * (f1 - f / radius)
    )
    return np.array([f, f1, moment, force])


def waves(square: float, layer: float) -> tuple[float, float]:
    """Wave numbers k of the J (or Y) and of the I (or K) in w where (ω/c)² = k²(1 + ℓ²k²)."""
    first = (np.sqrt(1 + 4 * layer**2 * square) - 1) / (2 * layer**2)
    return float(np.sqrt(first)), float(np.sqrt(first + layer**-2))


def plate_on_springs(order: int, layer: float, clamp: Clamp) -> float:
    """(ω/c)² of the lowest mode of the disc of radius 1 with `order` nodal diameters.

    V = −k w and M = −k_θ w' at its edge.
    """
    rigidity = TENSION * layer**2

    def miss(root: float) -> float:
        rows = []
        for kind, wave in zip("JI", waves(root**2, layer), strict=True):
            w, slope, moment, force = traces(kind, order, wave, 1.0, (layer, POISSON))
            held = w if np.isinf(clamp.deflection) else rigidity * force + clamp.deflection * w
            turned = (
                slope if np.isinf(clamp.rotation) else rigidity * moment + clamp.rotation * slope
            )
            rows.append(
                [held / clamp.deflection if np.isfinite(clamp.deflection) else held, turned]
            )
        return float(np.linalg.det(rows))

    return first_root(miss) ** 2


def everywhere(prestress: Prestress) -> tuple[Array, Array]:
    """Return distance (n,) from the origin and stress (n, 2) [Pa] at the points of quadrature.

    The stress is given by its mean (xx + yy)/2 and its deviator.
    """
    space = Space(prestress.domain.mesh, prestress.degree)
    point = np.concatenate([cell.jet.point.reshape(-1, 2) for cell in cells(space, 8)])
    xx, yy, xy = np.concatenate([s.reshape(-1, 3) for s in relaxed_stress(prestress, 8)]).T
    return np.hypot(*point.T), np.stack([(xx + yy) / 2, np.hypot((xx - yy) / 2, xy)], 1)
