"""The values between the stages that a diagnosis runs for each kind of measurement; effects change them, see `types.effect`."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from femnl.types.device import Film
from femnl.types.operators import Projection
from femnl.types.readout import Array, ComplexArray


@dataclass(frozen=True)
class ModalSystem:
    """Stage `operators`: K and M in the basis of the base modes. K x = ω² M x.

    stiffness (n, n) [N/m]; mass (n, n) [kg]; stress [Pa]: the film stress that K stands for; film; projection: integrals for changes.
    """

    stiffness: Array
    mass: Array
    stress: float
    film: Film
    projection: Projection

    @property
    def speed(self) -> float:
        """Speed of waves c = √(σ/ρ), in m/s."""
        return float(np.sqrt(self.stress / self.film.density))

    @property
    def wavenumber(self) -> Array:
        """K = ω/c of each base mode, (n,) [rad/m]."""
        return np.asarray(np.sqrt(np.diag(self.stiffness) / np.diag(self.mass)) / self.speed)

    def stretched(self, weight: int, xx: float, yy: float, xy: float = 0.0) -> "ModalSystem":
        """Add a film stress [Pa] with components xx, yy, xy times the weight of that index (see `WEIGHTS`)."""
        slopes = self.projection.slopes[weight]
        return replace(self, stiffness=self.stiffness + xx * slopes[0] + yy * slopes[1] + 2 * xy * slopes[2])


@dataclass(frozen=True)
class Lines:
    """Stage `frequencies`: what is read off for each measured mode, (n,) [Hz], and when [s] (empty where not recorded)."""

    frequency: Array
    time: Array


@dataclass(frozen=True)
class Oscillator:
    """Stage `oscillator`: one driven mode in volts of the linear readout, for every sweep.

    b [V] obeys b (δ + a|b|² + c|b|⁴ + i(1 + d|b|²)) = g F with δ = 2(f₀ − f)/w. frequency f₀ and linewidth w [Hz]; cubic a [V⁻²];
    quintic c [V⁻⁴]; damping d [V⁻²]; force F (n_sweeps,) [V of drive]; gain g [V/V].
    """

    frequency: float
    linewidth: float
    cubic: float
    quintic: float
    damping: float
    gain: float
    force: Array


@dataclass(frozen=True)
class Signal:
    """Stage `signal`: complex voltage (n,) [V] of each point; drive (n,) [V] and detuning from the resonance (n,) [Hz] there."""

    voltage: ComplexArray
    drive: Array
    detuning: Array


@dataclass(frozen=True)
class Motion:
    """Stage `motion`: u(t) = Σ_m Re(displacement_m e^{imωt}) at every point, and the phase θ of the fringe there.

    displacement (n_orders, n_points) [m], orders from 1; theta (n_points,) [rad]; x, y (n_points,) [m] on the film; shapes
    (n_modes, n_points) ξ of the lowest modes, `mode` the one that is driven; frequency of the drive [Hz]; wavelength [m].
    """

    displacement: ComplexArray
    theta: Array
    x: Array
    y: Array
    shapes: Array
    mode: int
    wavelength: float


@dataclass(frozen=True)
class Fringe:
    """Stage `fringe`: v = V_C Re Σ_k c_k e^{ik(qu + θ)}, clipped to [low, high] in units of V_C; c (n_overtones + 1,), q [rad/m]."""

    coefficients: ComplexArray
    wavenumber: float
    low: float = -np.inf
    high: float = np.inf


@dataclass(frozen=True)
class Harmonics:
    """Stage `harmonics`: V_n (n_harmonics, n_points) [V] of the orders `harmonic`, on points (x, y) [m]; frequency of the drive [Hz]."""

    values: ComplexArray
    harmonic: NDArray[np.int64]
    x: Array
    y: Array
    frequency: float


@dataclass(frozen=True)
class Points:
    """Stage `points`: frequency [Hz] and quality factor against the control variables that were recorded, each (n,)."""

    frequency: Array
    quality_factor: Array
    control: dict[str, Array]
    film: Film | None = None
