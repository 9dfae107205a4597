"""The values between the stages that a diagnosis runs for each kind of measurement.

Effects change them, see `types.effect`.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from femnl.core.device import Film, Stack
from femnl.core.errors import ParameterError
from femnl.core.operators import Projection
from femnl.core.readout import Array, ComplexArray
from femnl.core.tension import STRENGTHS, strengths

FOLLOWS_TENSION = 0.5
FOLLOWS_SIDES = 1.5
"""By how much the energy of bending changes where K does by 1, see `ModalSystem.tensioned`."""


@dataclass(frozen=True)
class ModalSystem:
    """Stage `operators`: K and M in the basis of the base modes. K x = ω² M x.

    stiffness (n, n) [N/m]; mass (n, n) [kg]; stress [Pa]: the film stress that K stands for; film;
    projection: integrals for changes;
    box: width and height [m] of a rectangular film, whose modes are sin·sin, None for any other
    outline; bending_length ℓ [m] that K stands for; layer (p, n): coefficients of each mode's k²
    [rad²/m²] as a polynomial in ℓ, which the clamped edge makes it; gap [m] below the film;
    airload (n, n) [m³], see `femnl.mechanics.airload`; tension (9,): strengths of `STRENGTHS` that
    K holds; unbent (n, n) [N/m]: what of K the energy of bending does not follow, as a spring of
    gas; speed_known: whether the speed of waves is known from elsewhere, so that a shift that all
    modes share is seen; area (n,) [m²]: ∫ξ² where layers lie on the film, empty without them;
    thicker (p, n, n) [N/m]: what layers of thickness h(1 + t) add to K, by powers of t from 1.
    """

    stiffness: Array
    mass: Array
    stress: float
    film: Film
    projection: Projection
    box: tuple[float, float] | None = None
    bending_length: float = 0.0
    layer: Array = field(default_factory=lambda: np.empty((0, 0)))
    gap: float = np.inf
    airload: Array = field(default_factory=lambda: np.empty((0, 0)))
    tension: Array = field(default_factory=lambda: np.zeros(len(STRENGTHS)))
    unbent: Array = field(default_factory=lambda: np.zeros((1, 1)))
    speed_known: bool = False
    area: Array = field(default_factory=lambda: np.empty(0))
    thicker: Array = field(default_factory=lambda: np.empty((0, 1, 1)))

    @property
    def speed(self) -> float:
        """Speed of waves c = √(σ/ρ), in m/s."""
        return float(np.sqrt(self.stress / self.film.density))

    @property
    def squared(self) -> Array:
        """∫ξ² of each base mode, (n,) [m²]."""
        if len(self.area):
            return self.area
        return np.asarray(np.diag(self.mass) / (self.film.density * self.film.thickness))

    @property
    def wavenumber(self) -> Array:
        """K = ω/c of each base mode, (n,) [rad/m]."""
        return np.asarray(np.sqrt(np.diag(self.stiffness) / np.diag(self.mass)) / self.speed)

    def bent(self, bending_length: float) -> "ModalSystem":
        """Change ℓ [m], with ω² = c²(k² + ℓ²k⁴)."""
        before = self._square(self.bending_length)
        after = self._square(bending_length)
        change = np.diag(np.diag(self.mass) * self.speed**2 * (after - before))
        return replace(self, stiffness=self.stiffness + change, bending_length=bending_length)

    def _square(self, length: float) -> Array:
        """Return (ω/c)² of each mode at an ℓ [m]."""
        k2 = (
            length ** np.arange(len(self.layer)) @ self.layer
            if len(self.layer)
            else self.wavenumber**2
        )
        return np.asarray(k2 + length**2 * k2**2)

    def tensioned(self, **changes: float) -> "ModalSystem":
        """Change the tension by strengths named in `STRENGTHS`, over those that act already.

        Most bending is in the layer ℓ = √(D/N) along the edge, ½ ∮ √(DN) (∂ₙξ)², where N is the
        tension across the edge. When the tension changes, this energy grows by half as much as K. A
        shear along the sides of a rectangle does not change it at all. When a side L changes, it
        goes as L⁻³ while K goes as L⁻², so that it grows by 1.5 times as much. This is right to a
        sixth of the largest change where both sides of a film are alike, and to a third where they
        differ by a fifth.
        """
        polynomial = self.projection.tension
        if polynomial is None:
            raise ParameterError("the changes of this film's tension were not solved for")
        after = self.tension + strengths(changes)
        more = self.stress * (polynomial(after) - polynomial(self.tension))
        followed = FOLLOWS_SIDES if "sides" in changes else FOLLOWS_TENSION
        if "shear" in changes and self.box is not None:
            followed = 0.0
        return replace(
            self,
            stiffness=self.stiffness + more,
            tension=after,
            unbent=self.unbent + (1 - followed) * more,
        )


@dataclass(frozen=True)
class Lines:
    """Stage `frequencies`: what is read off for each measured mode, (n,) [Hz].

    Of m films at once all of these arrays but `time` have a row of modes for each, (m, n), and the
    density of the film is (m, 1).

    time (n,) [s]: when it was measured, empty where that was not recorded. loss (n,): 1/Q, empty
    where no quality factor was measured. participation (3, n): squared share in each mode of a
    rigid motion of the film, up and down, tilting along x, and along y: (∫ρhφξ)²/(∫ρhφ² ∫ρhξ²).
    film, and the gap [m] below it; pressure [Pa] of the gas, 0 where not recorded.
    """

    frequency: Array
    time: Array
    loss: Array = field(default_factory=lambda: np.empty(0))
    participation: Array = field(default_factory=lambda: np.empty((3, 0)))
    film: Film | None = None
    gap: float = np.inf
    pressure: float = 0.0


@dataclass(frozen=True)
class Oscillator:
    """Stage `oscillator`: one driven mode.

    A [m] (f₀²(1 + ¾αA² + ⅝α₅A⁴) + 2f₀Π(A/A_s)^{2(p−1)} − f² + i f w(1 + ¼ηA²)) = f₀ w A₁ F.

    frequency f₀ (n_points,) and linewidth w [Hz]; alpha [m⁻²]; quintic α₅ [m⁻⁴]; damping η [m⁻²];
    force F (n_points,) in V of drive, peak A₁ [m/V]: the linear amplitude at resonance; time
    (n_points,) [s] at which each point was measured. For what depends on the frequency of the drive
    itself, driven f (n_points,) [Hz]; middle of those at which the mode moves strongly [Hz]; pull Π
    (n_points,) [Hz], which a mode near p·f adds at the amplitude A_s that stiffens the mode by one
    linewidth; order p.
    """

    frequency: Array
    linewidth: float
    alpha: float
    quintic: float
    damping: float
    force: Array
    peak: float
    time: Array
    driven: Array
    middle: float
    pull: ComplexArray
    order: float = 2.0


@dataclass(frozen=True)
class Equation:
    """Stage `equation`: the forces on one mode while it moves freely in time.

    c (1 + ηy²) ẏ + k (y + κ₂y² + αy³ + α₅y⁵).

    quadratic κ₂, cubic α, quintic α₅ and damping η in powers of 1/y, where y is what the record
    holds.
    """

    quadratic: float
    cubic: float
    quintic: float
    damping: float


@dataclass(frozen=True)
class Signal:
    """Stage `signal`: V (n,) [V] of each point, for |A| (n,) [m] at a drive (n,) [V].

    wavelength [m], 0 where not recorded. largest [V]: the strongest signal that was measured.
    detuning (n,) [Hz]: f − f₀ of the drive; shape (n,): ξ where the laser meets the film, 1 where
    its place was not recorded.
    """

    voltage: ComplexArray
    amplitude: Array
    drive: Array
    wavelength: float
    largest: float
    detuning: Array
    shape: Array


@dataclass(frozen=True)
class Acquisition:
    """Stage `acquisition`: what each point of a sweep keeps of the one before it.

    motion: e^{−πwT}, of a deviation from the steady motion; filtered: of a step, behind a low pass
    of `poles` equal poles; T: time from one point to the next.
    """

    motion: float = 0.0
    filtered: float = 0.0
    poles: float = 1.0


@dataclass(frozen=True)
class Placement:
    """Stage `placement`: where the laser meets the simulated film.

    x, y (n_points,) [m], and the sd [m] of its spot.
    """

    x: Array
    y: Array
    spot: float = 0.0


@dataclass(frozen=True)
class Motion:
    """Stage `motion`: the displacement at every point, and the phase of the fringe there.

    u(t) = Σ_m Re(displacement_m e^{imωt}); θ is the phase.

    displacement (n_orders, n_points) [m], orders from 1; theta (n_points,) [rad]; x, y (n_points,)
    [m] on the film; shapes (n_modes, n_points): ξ of the lowest modes; frequencies (n_modes,) [Hz];
    mode: the one that is driven; swing (n_points,) [m]: its amplitude U e^{iφ} where |ξ| = 1, while
    each point was measured; wavelength [m]; time (n_points,) [s] at which each point was measured,
    empty where that was not recorded.
    """

    displacement: ComplexArray
    theta: Array
    x: Array
    y: Array
    shapes: Array
    frequencies: Array
    mode: int
    swing: ComplexArray
    wavelength: float
    time: Array = field(default_factory=lambda: np.empty(0))

    def driven(self, swing: ComplexArray) -> "Motion":
        """Let the whole motion follow another swing (n_points,) [m]: at nω by its n-th power."""
        still = self.swing == 0
        factor = np.where(still, 0, swing) / np.where(still, 1, self.swing)
        order = np.arange(1, len(self.displacement) + 1)[:, None]
        displacement = self.displacement * factor**order
        return replace(self, displacement=displacement, swing=swing)

    def raised(self, order: int, added: ComplexArray) -> "Motion":
        """Add the displacement (n_points,) [m] at a multiple of the drive."""
        missing = max(order - len(self.displacement), 0)
        displacement = np.concatenate([self.displacement, np.zeros((missing, len(self.x)))])
        displacement[order - 1] += added
        return replace(self, displacement=displacement)

    def shifted(self, rest: Array) -> "Motion":
        """Move the film by (n_points,) [m] at rest, which turns the fringe."""
        return replace(self, theta=self.theta + 4 * np.pi / self.wavelength * rest)


@dataclass(frozen=True)
class Wave:
    """The fringe of one plane wave: c_k (n_overtones + 1,), and 4π over the wavelength [m] is q."""

    coefficients: ComplexArray
    wavelength: float


@dataclass(frozen=True)
class Fringe:
    """Stage `fringe`: v = V_C Re Σ_k c_k e^{ik(qu + θ)}, c (n_overtones + 1,).

    It is clipped at floor and limit, in units of its largest value.

    stack: of the geometry, None where it gives none; wavelength [m], q = 4π/wavelength. beside:
    further plane waves of a focused beam, whose light the detector adds.
    """

    coefficients: ComplexArray
    wavelength: float
    stack: Stack | None
    limit: float = np.inf
    floor: float = -np.inf
    beside: tuple[Wave, ...] = ()


@dataclass(frozen=True)
class Harmonics:
    """Stage `harmonics`: V_n (n_harmonics, n_points) [V] of the orders `harmonic`.

    frequency of the drive [Hz], one or (n_points,); drive [V], 1 where not recorded.
    """

    values: ComplexArray
    harmonic: NDArray[np.int64]
    frequency: float | Array
    drive: float = 1.0


@dataclass(frozen=True)
class Points:
    """Stage `points`: frequency [Hz] and quality factor, each (n,).

    Against the control variables that were recorded. film, and the gap [m] below it; spot: ξ²
    under the laser, in parts of what it was in the measurement.
    """

    frequency: Array
    quality_factor: Array
    control: dict[str, Array]
    film: Film | None = None
    gap: float = np.inf
    spot: float = 1.0


@dataclass(frozen=True)
class Dissipation:
    """Stage `dissipation`: how a mode loses energy at each size of its motion.

    level (m,): ln of the energy over that at the begin of the decay, falling from 0. rate (m,)
    [1/s] at which the energy decays there; slow [1/s]: that of small motion without any cause.
    pull (m,) [Hz]: by how much the frequency differs from that of small motion.
    """

    level: Array
    rate: Array
    slow: float
    pull: Array


@dataclass(frozen=True)
class Ringing:
    """Stage `ringing`: all that moves within the bandwidth of an analyser after a switch-off.

    time (n,) [s] from the begin; amplitude (n,), complex, in units of that of the mode at the
    begin, in a frame that turns at the frequency of small motion; slow [1/s]: the rate at which the
    mode's energy decays; frequency [Hz] of the mode, 0 where not known.
    """

    time: Array
    amplitude: ComplexArray
    slow: float
    frequency: float


@dataclass(frozen=True)
class Reading:
    """Stage `reading`: what readout and analyser make of a motion.

    The signal is gain · amplitude + added, in units of the mode's amplitude at the begin.
    time (n,) [s] from the begin; gain (n,); added (n,): what passes by the mode; bandwidth of the
    analyser in parts of that of the measurement; drive: whether the generator is connected.
    """

    time: Array
    gain: Array
    added: ComplexArray
    bandwidth: float = 1.0
    drive: bool = True
