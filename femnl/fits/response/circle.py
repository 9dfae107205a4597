"""A start beside a strong background: the circle that a mode runs over at every drive.

V/drive = C + B/(X + i): where the damping is constant, the detuning X is real, whatever the
amplitude does to it. So V/drive of all sweeps lies on one circle, which holds C. Once a place of C
is chosen on it, each point tells its X, and X = 2(f₀ − f)/w + a drive²/(1 + X²) is linear in f₀/w,
1/w and a, whatever branch a point lies on.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from femnl.core.robust import MAD
from femnl.fits.outliers import MOST_GLITCHES
from femnl.observe.response.branches import STIFFEN
from femnl.observe.response.sweeps import Array, Complex, Sweeps
from femnl.observe.response.theta import Layout

Mask = NDArray[np.bool_]
PLACES = np.linspace(0, 2 * np.pi, 360, endpoint=False)
"""Places of C on the circle that are tried, as φ of B."""
FEWEST = 8
"""Points of a circle and a line through their detunings."""
ROUNDS = 10
"""Times that a circle is fitted without what is off it, at most."""
APART = 6.0
"""Scatters off the circle from which on a point may be a glitch."""
ON_CIRCLE = 1.5
"""Mean square [σ²] of what the others are off it, at most."""
AROUND = 0.05
"""Part of the others on the half of the circle where most are not, at least."""
SMALLEST = 1e-12
"""Radius by the distance from 0 of a circle that is no rounding."""


@dataclass(frozen=True)
class _Circle:
    """The circle through V/drive at one position: centre, radius [V], and the points of its fit.

    frequency (n,) [Hz] from a centre; points (n,) [V]; drive (n,), relative; weight (n,): drive
    over noise.
    """

    frequency: Array
    points: Complex
    drive: Array
    weight: Array
    centre: complex
    radius: float

    @property
    def strength(self) -> float:
        """Radius over noise, of all points together."""
        return self.radius * float(np.linalg.norm(self.weight))

    def background(self, phi: float) -> complex:
        """Return C [V] where B has the phase φ."""
        return self.centre + 1j * self.radius * complex(np.exp(1j * phi))

    def detuning(self, phi: float) -> tuple[Array, Array]:
        """Return X of each point, and its weight: 1/sd, both (n,)."""
        away = self.points - self.background(phi)
        size = 2 * self.radius
        away = np.where(away == 0, np.finfo(float).eps * size, away)
        detuning = np.real(size * np.exp(1j * phi) / away)
        return detuning, self.weight * size / (1 + detuning**2)

    def _columns(self, detuning: Array) -> Array:
        energy = self.drive**2 / (1 + detuning**2)
        return np.column_stack([np.ones(len(detuning)), self.frequency, energy])

    def line(self, phi: float) -> tuple[Array, float]:
        """Return p of X = p₀ + p₁f + p₂ drive²/(1 + X²), and what that leaves, in σ²."""
        detuning, weight = self.detuning(phi)
        columns = self._columns(detuning)
        scale = _sizes(columns * weight[:, None])
        scaled = columns * weight[:, None] / scale
        found: Array = np.linalg.lstsq(scaled, detuning * weight, rcond=1e-9)[0] / scale
        return found, float(np.sum((weight * (detuning - columns @ found)) ** 2))

    def place(self, line: Array) -> float:
        """Return the φ that suits best what another position tells of X."""

        def missed(phi: np.float64) -> float:
            detuning, weight = self.detuning(float(phi))
            return float(np.sum((weight * (detuning - self._columns(detuning) @ line)) ** 2))

        return float(min(PLACES, key=missed))


def circle_starts(sweeps: Sweeps, layout: Layout) -> list[Array]:
    """Return starts θ of a Duffing mode beside a background that grows with the drive.

    One takes the background for constant, and one for sloping where the layout has that.
    Args: layout: of a background of at least one term, with gains and phases.
    Valid: high Q; no delay; damping that does not depend on the amplitude.
    Source: the circle of a linear resonance: Petersan & Anlage, J. Appl. Phys. 84, 3392 (1998).
    """
    level = np.zeros(sweeps.n_positions, dtype=np.complex128)
    slopes = [level]
    if layout.background > 1:
        slopes.append(_slopes(sweeps, layout))
    starts = (_start(sweeps, layout, slope) for slope in slopes)
    return [start for start in starts if start is not None]


def _slopes(sweeps: Sweeps, layout: Layout) -> Complex:
    """Return C₁·span (n_positions,) [V] of a background C + C₁(f − centre) beside circles.

    |z − c − C₁a|² = r² is linear in c, C₁, and the factors of a, a² and 1, taken as unknowns.
    """
    found = np.zeros(sweeps.n_positions, dtype=np.complex128)
    for p in range(sweeps.n_positions):
        at = sweeps.position == p
        drive = sweeps.drive[at]
        z = sweeps.voltage[at] / drive
        z = z - z.mean()
        a = (sweeps.frequency[at] - layout.centre) / layout.span
        columns = [z.real, z.imag, a * z.real, a * z.imag, a, a**2, np.ones(len(a))]
        weighted = np.stack(columns, axis=1) * drive[:, None]
        scale = _sizes(weighted)
        taken = np.linalg.lstsq(weighted / scale, np.abs(z) ** 2 * drive, rcond=1e-12)[0] / scale
        found[p] = complex(taken[2], taken[3]) / 2
    return found


def _sizes(columns: Array) -> Array:
    """Return the size of each column (k,), and 1 for one that vanishes."""
    size = np.linalg.norm(columns, axis=0)
    return np.asarray(np.where(size > 0, size, 1.0), dtype=float)


def _start(sweeps: Sweeps, layout: Layout, slope: Complex) -> Array | None:
    """Return θ where the background has a slope (n_positions,), None where no circle tells one."""
    away = (sweeps.frequency - layout.centre) / layout.span
    level = replace(sweeps, voltage=sweeps.voltage - slope[sweeps.position] * away * sweeps.drive)
    everywhere = range(sweeps.n_positions)
    circles = [_circle(level, level.position == p, layout.centre) for p in everywhere]
    known = [circle for circle in circles if circle is not None]
    if len(known) < len(circles):
        return None
    clearest = max(known, key=lambda circle: circle.strength)
    lines = [clearest.line(phi) for phi in PLACES.tolist()]
    # Where the phase falls through the resonance, X falls with frequency
    falling = [one for one in lines if one[0][1] < 0]
    if not falling:
        return None
    line, _ = min(falling, key=lambda one: one[1])
    places = [circle.place(line) for circle in known]
    width = -2 / line[1]
    theta = np.zeros(layout.size)
    theta[0] = line[0] * width / 2 / layout.width
    theta[1] = np.log(width / layout.width)
    theta[2] = line[2] / STIFFEN
    theta[layout.gains] = np.log([2 * circle.radius for circle in known])
    theta[layout.phases] = places
    behind = np.zeros((len(known), layout.background), dtype=np.complex128)
    behind[:, 0] = [c.background(phi) for c, phi in zip(known, places, strict=True)]
    behind[:, 0] += slope * theta[0] * layout.width / layout.span
    behind[:, 1:] = slope[:, None]
    theta[layout.backgrounds] = np.stack([behind.real, behind.imag], axis=-1).ravel()
    return theta if np.isfinite(theta).all() else None


def off_circle(sweeps: Sweeps) -> Mask:
    """Return which points (n,) are far off the circle that all others lie on, at each position.

    No point is where the others scatter about it by more than noise, as of a mode whose damping
    grows, where more are off than glitches may be, and where few others are on the far half of the
    circle: what is left without a narrow resonance is noise, and that is on a circle, too.
    """
    found = np.zeros(len(sweeps.voltage), dtype=bool)
    points = sweeps.voltage / sweeps.drive
    for p in range(sweeps.n_positions):
        here = sweeps.position == p
        kept = here
        for _ in range(ROUNDS):
            circle = _circle(sweeps, kept, 0.0)
            if circle is None:
                break
            away = np.abs(np.abs(points - circle.centre) - circle.radius)
            away *= sweeps.drive / sweeps.noise
            before = kept
            kept = here & (away < APART * max(MAD * float(np.median(away[here])), 1.0))
            if np.array_equal(kept, before):
                off = here & ~kept
                few = np.count_nonzero(off) <= MOST_GLITCHES * np.count_nonzero(here)
                on_it = np.mean(away[kept] ** 2) < ON_CIRCLE
                if few and on_it and _far_half(circle) > AROUND:
                    found |= off
                break
    return found


def _far_half(circle: _Circle) -> float:
    """Return the part of its points that lie on the half of a circle where most do not."""
    away = circle.points - circle.centre
    most = complex(np.median(away.real), np.median(away.imag))
    return float(np.mean((away * np.conj(most)).real < 0))


def _circle(sweeps: Sweeps, at: Mask, centre: float) -> _Circle | None:
    """Return the circle through V/drive of some points, None through too few or equal ones.

    It minimises Σ(weight (|z − c|² − r²))², which is linear in c and r² − |c|².
    """
    if np.count_nonzero(at) < FEWEST:
        return None
    drive = sweeps.drive[at]
    points = sweeps.voltage[at] / drive
    weight = drive / sweeps.noise
    middle = complex(np.mean(points))
    size = float(np.abs(points - middle).max())
    if not (np.isfinite(size) and size > SMALLEST * abs(middle)):
        return None
    z = (points - middle) / size
    columns = np.column_stack([2 * z.real, 2 * z.imag, np.ones(len(z))]) * weight[:, None]
    (x, y, rest), *_ = np.linalg.lstsq(columns, np.abs(z) ** 2 * weight, rcond=None)
    square = rest + x**2 + y**2
    if not square > 0:
        return None
    return _Circle(
        frequency=sweeps.frequency[at] - centre,
        points=points,
        drive=drive,
        weight=weight,
        centre=middle + size * complex(x, y),
        radius=size * float(np.sqrt(square)),
    )
