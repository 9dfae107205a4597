"""A particle on the film."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import ModalSystem


def load(system: ModalSystem, values: Values) -> ModalSystem:
    """Add Δm ξᵢ(x₀) ξⱼ(x₀) to the masses.

    Raised by the compliance G of all higher modes, on which the particle rides.

    Eliminating a mass on a spring 1/G turns Δm into Δm/(1 − ω²ΔmG), taken here at the frequencies
    of both modes. G = s/2πT grows with the logarithm of cut-off wavelength over size of the
    particle: for a point it would be infinite.
    """
    shape = system.projection.at(values["x"], values["y"])
    square = np.diag(system.stiffness) / np.diag(system.mass)
    compliance = values["spread"] / (2 * np.pi * system.stress * system.film.thickness)
    ride = square * values["mass"] * compliance
    # 1/(1 − x) to second order, which stays positive beyond where the equation holds
    ride = shape * np.sqrt(1 + ride + ride**2)
    return replace(system, mass=system.mass + values["mass"] * np.outer(ride, ride))


EFFECT = Effect(
    name="added_mass",
    equation="M → M + Δm ξ(x₀) ξ(x₀)ᵀ/(1 − ω²ΔmG); to first order Δf/f = −½ Δm ξ²(x₀)/m_eff",
    parameters=(
        ParameterSpec("mass", "kg", 0.0, 0.05, scale="mass"),
        ParameterSpec("x", "m", -1.0, 1.0, strength=False, scale="reach"),
        ParameterSpec("y", "m", -1.0, 1.0, strength=False, scale="reach"),
        ParameterSpec("spread", "1", 0.0, 5.0, strength=False),
    ),
    changes={"operators": load},
    source="Rayleigh's method, e.g. Hanay et al., Nat. Nanotechnol. 10, 339 (2015); the "
    "logarithm: Green's "
    "function of "
    "a membrane",
    limits="a particle small against the wavelength; on a symmetric film its images under the "
    "symmetry are the "
    "same to "
    "frequencies",
    sentence="a particle sits on the film",
)
