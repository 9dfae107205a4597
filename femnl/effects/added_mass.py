"""A particle on the film, or one that it lost."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
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
    # Above 0, 1/(1 − x) to second order, which stays positive beyond where the equation holds
    factor = np.where(ride > 0, 1 + ride + ride**2, 1 / (1 + np.abs(ride)))
    ride = shape * np.sqrt(factor)
    return replace(system, mass=system.mass + values["mass"] * np.outer(ride, ride))


EFFECT = Effect(
    name="added_mass",
    accuracy=0.01,
    accuracy_reason="a particle is no point: over 1 % of the film ξ² varies by a percent",
    imitates={
        "spectrum": {
            "aspect_ratio": 0.96,
            "stress_anisotropy": 0.96,
            "yielding_edge": 0.96,
            "trapped_gas": 0.92,
            "frame_mode": 0.83,
            "tension_gradient": 0.77,
            "bending_stiffness": 0.72,
            "shear_stress": 0.66,
            "frequency_drift": 0.6,
            "compliant_clamp": 0.59,
            UNKNOWN: 0.98,
        }
    },
    equation="M → M + Δm ξ(x₀) ξ(x₀)ᵀ/(1 − ω²ΔmG); to first order Δf/f = −½ Δm ξ²(x₀)/m_eff",
    parameters=(
        ParameterSpec(
            "mass",
            "kg",
            -0.01,
            0.05,
            scale="mass",
            reason="a grain of 2 to 8 g/cm³ with a twentieth of the film's mass is as wide as the "
            "film's short waves; residue that can be lost is less than a hundredth",
        ),
        ParameterSpec(
            "x", "m", -1.0, 1.0, strength=False, scale="reach", reason="it lies on the film"
        ),
        ParameterSpec(
            "y", "m", -1.0, 1.0, strength=False, scale="reach", reason="it lies on the film"
        ),
        ParameterSpec(
            "spread",
            "1",
            0.0,
            5.0,
            strength=False,
            reason="the logarithm of wavelength over size of a grain, which is 5 for a film of "
            "300 µm and a grain of 1 µm",
        ),
    ),
    changes={"operators": load},
    source="Rayleigh's quotient of all modes together with the mass at one place; the logarithm: "
    "Green's function of a membrane",
    limits="a particle small against the wavelength; on a symmetric film its images under the "
    "symmetry are the same to frequencies; lost material leaves the tension as it was, as a hole "
    "does not",
    sentence="a particle sits on the film, or left it",
)
