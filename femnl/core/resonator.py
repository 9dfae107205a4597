"""Nonlinear resonators in modal coordinates and their periodic motions."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.core.arrays import freeze

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class Resonator:
    """One mode: ü + γ (1 + η u²) u̇ + ω₀² (u + κ₂ u² + α u³ + α₅ u⁵) = 𝓕 cos ωt.

    frequency f₀ = ω₀/2π [Hz]; quality_factor Q, γ = ω₀/Q = 2πw; alpha = k₃/k [m⁻²]; quadratic κ₂ =
    k₂/k [m⁻¹]; quintic α₅ = k₅/k [m⁻⁴]; nonlinear_damping η [m⁻²]. The force 𝓕 is per effective
    mass, in m/s².
    """

    frequency: float
    quality_factor: float
    alpha: float = 0.0
    quadratic: float = 0.0
    quintic: float = 0.0
    nonlinear_damping: float = 0.0

    @property
    def omega(self) -> float:
        """Angular frequency ω₀ = 2πf₀, in rad/s."""
        return 2 * np.pi * self.frequency

    @property
    def damping(self) -> float:
        """Damping rate γ = ω₀/Q, in 1/s."""
        return self.omega / self.quality_factor

    @property
    def linewidth(self) -> float:
        """Linewidth w = f₀/Q = γ/2π, in Hz."""
        return self.frequency / self.quality_factor

    @property
    def effective_alpha(self) -> float:
        """Effective α − (10/9)κ₂².

        What the first harmonic feels of the cubic and the quadratic term together, in m⁻².
        """
        return self.alpha - 10 / 9 * self.quadratic**2


@dataclass(frozen=True)
class CoupledModes:
    """Coupled nonlinear modes under one drive.

    q̈ᵢ + γᵢ (1 + ηᵢ qᵢ²) q̇ᵢ + ωᵢ² qᵢ + Σ quadraticᵢⱼₖ qⱼqₖ + Σ cubicᵢⱼₖₗ qⱼqₖqₗ + quinticᵢ qᵢ⁵
    = 𝓕ᵢ cos ωt.

    frequency (n,) [Hz]; damping γ (n,) [1/s]; quadratic (n,n,n) [s⁻² m⁻¹] and cubic (n,n,n,n) [s⁻²
    m⁻²], symmetric in all but the first index; quintic (n,) [s⁻² m⁻⁴]; nonlinear_damping η (n,)
    [m⁻²].
    """

    frequency: Array
    damping: Array
    quadratic: Array
    cubic: Array
    quintic: Array
    nonlinear_damping: Array

    def __post_init__(self) -> None:
        freeze(self)

    @property
    def omega(self) -> Array:
        """Angular frequencies ωᵢ = 2πfᵢ, in rad/s."""
        return np.asarray(2 * np.pi * self.frequency)

    @property
    def count(self) -> int:
        """How many modes are coupled."""
        return len(self.frequency)


@dataclass(frozen=True)
class Branches:
    """All steady states at each drive frequency, by rising amplitude: u(t) = Re(A e^{iωt}).

    frequency (n,) [Hz]; amplitude A (n, m) [m], NaN where a state is missing; stable (n, m), False
    there.
    """

    frequency: Array
    amplitude: Complex
    stable: NDArray[np.bool_]

    def __post_init__(self) -> None:
        freeze(self)


@dataclass(frozen=True)
class PeriodicMotion:
    """Periodic motions along a curve or a sweep.

    qᵢ(t) = Re Σ_h coefficients[p, i, h] e^{ihωt}, h = 0 … H.

    frequency (p,) of the drive [Hz]; coefficients (p, modes, H + 1) [m], the constant part real;
    stable (p,); multipliers (p, 2·modes): Floquet multipliers over one drive period.
    """

    frequency: Array
    coefficients: Complex
    stable: NDArray[np.bool_]
    multipliers: Complex

    def __post_init__(self) -> None:
        freeze(self)

    def at(self, phase: Array) -> Array:
        """Return the displacement (p, modes, phases) [m] at the drive phases ωt [rad]."""
        order = np.arange(self.coefficients.shape[-1])
        return np.asarray((self.coefficients @ np.exp(1j * np.outer(order, phase))).real)
