"""What gas, frame and chip do to the modes of a film, by equations of motion of all together.

Rectangles of sines: see `Membrane`, whose ξ has a mean square of 1.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig

from femnl.core.device import Film
from tests.blind.lab.bench import INEXACT, Array, Values
from tests.blind.lab.film import Membrane

KEPT = 40
"""Modes of the film without loss in which those with loss are expanded."""
RAYS = 96
RADII = 160
"""Gauss points over directions and distances between two places of the film."""
LEVELS = (200, 400)
"""Steps through the gap, of which the error of second order is taken off."""
SECOND_FRAME = 1.013
"""Frequency of the second mode of a frame in units of that of the first."""
ROUNDS = 3
"""Times that the loss of a mode is taken at its own frequency."""


def gas_above(sides: tuple[float, float], basis: int) -> Array:
    """Return ∫∫ξξ′/(2πr) over the area [m], (basis², basis²)."""
    return sides[0] * _gas_above((1.0, sides[1] / sides[0]), basis)


@cache
def _gas_above(sides: tuple[float, float], basis: int) -> Array:
    """In polar coordinates of the distance between two places, for sides in any unit.

    Each product of sines has a correlation in closed form.
    """
    nodes, weight = np.polynomial.legendre.leggauss(RAYS)
    angle = (nodes + 1) * np.pi / 4
    corner = np.minimum(sides[0] / np.cos(angle), sides[1] / np.sin(angle))
    nodes, share = np.polynomial.legendre.leggauss(RADII)
    radius = np.outer(corner, (nodes + 1) / 2)
    area = np.outer(weight * np.pi / 4 * corner, share / 2)
    along = _correlation(basis, radius * np.cos(angle)[:, None] / sides[0]) * sides[0]
    across = _correlation(basis, radius * np.sin(angle)[:, None] / sides[1]) * sides[1]
    size = basis * basis
    x = along.reshape(size, -1) * area.ravel()
    table = (x @ across.reshape(size, -1).T).reshape(basis, basis, basis, basis)
    # ξ is twice the product of two sines; four quadrants, of which odd products cancel
    found = 4 * 4 / (2 * np.pi) * table.transpose(0, 2, 1, 3).reshape(size, size)
    return np.asarray(found / (sides[0] * sides[1]))


def _correlation(basis: int, shift: Array) -> Array:
    """∫ sin(mπt) sin(nπ(t + s)) dt over where both are on [0, 1], even in s, (m, n, *shift)."""
    m = np.arange(1, basis + 1)[:, None, None, None] * np.pi
    n = np.arange(1, basis + 1)[None, :, None, None] * np.pi
    unequal = np.where(m == n, np.pi, m - n)
    end = 1 - shift

    def antiderivative(t: Array | float, same: bool) -> Array:
        plus = np.sin((m + n) * t + n * shift) / (m + n)
        if same:
            return np.asarray((t * np.cos(n * shift) - plus) / 2)
        return np.asarray((np.sin((m - n) * t - n * shift) / unequal - plus) / 2)

    whole = np.where(
        m == n,
        antiderivative(end, True) - antiderivative(0.0, True),
        antiderivative(end, False) - antiderivative(0.0, False),
    )
    return np.asarray((whole + whole.transpose(1, 0, 2, 3)) / 2)


def gas_below(wavenumber: Array, gap: float) -> Array:
    """Return the depth of gas that each wave moves over a wall [m], by differences in height.

    φ'' = k²φ, φ' = 1 at the film and 0 at the wall.
    """

    def solved(n: int) -> Array:
        step = gap / n
        # From the wall, where φ is even: a recurrence that grows and is stable.
        low: Array = np.ones_like(wavenumber)
        high: Array = 1 + (wavenumber * step) ** 2 / 2
        for _ in range(n):
            low, high = high, (2 + (wavenumber * step) ** 2) * high - low
        before = (low * (2 + (wavenumber * step) ** 2)) - high
        return np.asarray(low * 2 * step / (high - before))

    coarse, fine = (solved(n) for n in LEVELS)
    return np.asarray((4 * fine - coarse) / 3)


def trapped(square: Array, spring: float, escape: Array | list[float]) -> NDArray[np.complex128]:
    """Return the complex ω² of modes with ω² = `square` alone and gas that leaves in `escape` [s].

    Exact eigenvalues of film and pressure together: ẅ = −ω²w − q, q̇ = −q/τ + s ẇ with
    s = np/(ρhd) [1/s²].
    """
    found = []
    for w2, tau in zip(square, escape, strict=True):
        unit = np.sqrt(w2)
        roots = np.roots([1, 1 / (tau * unit), 1 + spring / w2, 1 / (tau * unit)])
        decay = roots[np.argmax(roots.imag)] * unit
        found.append(-(decay**2))
    return np.array(found)


@dataclass(frozen=True)
class Lossy:
    """The film with its loss: stiffness and mass of modes (n, n), and what they hand the chip.

    rigid (3, n): ∫φξ over √(∫φ² area), φ = 1, x, y: the mass that moves with the chip.
    """

    stiffness: Array
    mass: Array
    rigid: Array

    def solve(self, frame: Values, clamp: Values, count: int) -> tuple[Array, Array, Array]:
        """Return frequencies, 1/Q and vectors (n, count) of the film's lowest modes."""
        stiffness = self.stiffness.astype(complex)
        mass = self.mass.astype(complex)
        n = len(mass)
        if frame:
            stiffness, mass = self._framed(stiffness, mass, frame)
            if frame.get(INEXACT, 0.0):
                stiffness, mass = self._framed(stiffness, mass, _second(frame))
        square, vectors = _modes(stiffness, mass, n)
        if clamp:
            square = self._radiating(square, vectors, clamp, stiffness, mass, n)
        order = np.argsort(square.real)[:count]
        square = square[order]
        root = np.sqrt(square)
        return (
            root.real / (2 * np.pi),
            2 * root.imag / root.real,
            np.abs(vectors[:n, order]),
        )

    def _framed(self, stiffness: Array, mass: Array, frame: Values) -> tuple[Array, Array]:
        """Add the frame's own motion of each kind, whose inertia the film's modes feel."""
        ratios = np.array([frame.get(name, 0.0) for name in ("heave", "tilt_x", "tilt_y")])
        push = ratios @ self.rigid
        push = np.pad(push, (0, len(mass) - len(push)))
        own = (2 * np.pi * frame["frame_frequency"]) ** 2 * (1 + 1j * frame["frame_loss"])
        n = len(mass)
        wider = np.zeros((2, n + 1, n + 1), complex)
        wider[0, :n, :n] = stiffness
        wider[1, :n, :n] = mass
        wider[0, n, n] = own
        wider[1, n, n] = 1
        wider[1, n, :n] = wider[1, :n, n] = push
        return wider[0], wider[1]

    def _radiating(
        self,
        square: Array,
        vectors: Array,
        clamp: Values,
        stiffness: Array,
        mass: Array,
        n: int,
    ) -> Array:
        """Let the chip yield with a lag to the force ω²∫ρhξ, at the frequency of each mode."""
        lowest = float(np.min(square.real))
        found = square.copy()
        for k in range(len(square)):
            for _ in range(ROUNDS):
                ratio = np.sqrt(found[k].real / lowest)
                tilt = clamp["dipole"] ** 2 * ratio**3
                lag = clamp["monopole"] * np.array([ratio, tilt, tilt])
                more = np.zeros_like(stiffness)
                more[:n, :n] = 1j * lowest * ratio**4 * (self.rigid.T * lag) @ self.rigid
                values, shapes = _modes(stiffness + more, mass, n)
                overlap = np.abs(vectors[:, k].conj() @ shapes)
                found[k] = values[int(np.argmax(overlap))]
        return found


def _second(frame: Values) -> Values:
    """Return another mode of the frame, of a part of the coupling of the first."""
    ratios = {name: frame[INEXACT] * frame[name] for name in ("heave", "tilt_x", "tilt_y")}
    return frame | ratios | {"frame_frequency": frame["frame_frequency"] * SECOND_FRAME}


def _modes(stiffness: Array, mass: Array, n: int) -> tuple[Array, Array]:
    """Return ω² and vectors of the modes that are the film's, which has the first n rows."""
    square, vectors = eig(stiffness, mass)
    vectors = vectors / np.linalg.norm(vectors, axis=0)
    film = np.argsort(-np.sum(np.abs(vectors[:n]) ** 2, axis=0))[:n]
    order = film[np.argsort(square[film].real)]
    return square[order], vectors[:, order]


def rigid(modes: Membrane) -> Array:
    """Return ∫φξ/√(∫φ² area) of the modes, (3, n), for φ = 1, x, y.

    In closed form for sines; else by sums over even points.
    """
    if len(modes.orders):
        odd = modes.orders % 2 == 1
        mean = np.where(odd, 2 / np.pi / modes.orders, 0.0) * np.sqrt(2)
        # ∫ x sin over a side, x from the middle in units of the half side, over its rms 1/√3
        slope = np.where(odd, 0.0, 2 / np.pi / modes.orders) * np.sqrt(2) * np.sqrt(3)
        return np.stack(
            [mean[:, 0] * mean[:, 1], slope[:, 0] * mean[:, 1], mean[:, 0] * slope[:, 1]]
        )
    return _summed(modes)


def _summed(modes: Membrane, points: int = 90) -> Array:
    axis = (np.linspace(-1, 1, 2 * points + 1)[1::2]) * modes.half
    x, y = (part.ravel() for part in np.meshgrid(axis, axis))
    shapes = modes.at(x, y)
    cell = (axis[1] - axis[0]) ** 2
    inside = np.any(shapes != 0, axis=0)
    rows = [
        shapes @ (phi * inside) * cell / np.sqrt(np.sum(phi**2 * inside) * cell * modes.area)
        for phi in (np.ones_like(x), x, y)
    ]
    return np.array(rows)


def gas_above_wave(wavenumber: Array) -> Array:
    """Return the depth of gas that a plane wave moves above it [m]: twice its energy per area."""
    t, weight = np.polynomial.laguerre.laggauss(40)
    # Both components of the velocity e^{−kz} hold the same
    return np.asarray(np.sum(2 * np.exp(-t) * weight) / wavenumber)


def delayed(square: float, spring: Array, lag: float) -> NDArray[np.complex128]:
    """Return the complex ω² of a mode under a force that follows it with one relaxation time.

    ẅ = −ω²w − f, ḟ = (s ω² (1 + b²) w − f)/τ, b = ωτ; s is what the force does to ω² at ω.
    """
    if lag == 0:
        return np.asarray(square * (1 + spring), np.complex128)
    unit = np.sqrt(square)
    found = []
    for s in spring:
        roots = np.roots([1, 1 / lag, 1, (1 + s * (1 + lag**2)) / lag])
        root = roots[np.argmax(roots.imag)] * unit
        found.append(-(root**2))
    return np.array(found)


WAFER = 3000.0
"""Thickness of a wafer in those of its film."""
WAFER_YOUNG = 180e9
"""Biaxial modulus of silicon (100) [Pa]."""


def warmed(film: Film, slope: float, warm: Array) -> Array:
    """Return ω² over that at the mean temperature, of a film on a wafer that both expand.

    slope: relative change of stress [1/K], which gives the difference of expansions.
    """
    modulus = film.young / (1 - film.poisson)
    difference = slope * film.stress / modulus
    # The common strain at which the forces of film and wafer add up to nothing
    pull = modulus * film.thickness
    hold = WAFER_YOUNG * WAFER * film.thickness
    strain = pull * difference * warm / (pull + hold)
    return np.asarray(1 + modulus * (strain - difference * warm) / film.stress)


def charged(voltage: Array, gap: float, softening: float, offset: float) -> Array:
    """Return ω² over that at 0 V of a plate on a spring over an electrode.

    From its energy q²/2 − s(V − V₀)²d³/(2(d − q)) [of its stiffness], whose minimum and curvature
    there are found by differences.
    """

    def square(volts: float) -> float:
        force = softening * (volts - offset) ** 2 * gap**3 / 2
        rest = 0.0
        for _ in range(50):
            rest = force / (gap - rest) ** 2
        step = 1e-3 * gap
        energy = [q**2 / 2 - force / (gap - q) for q in (rest - step, rest, rest + step)]
        return (energy[0] - 2 * energy[1] + energy[2]) / step**2

    return np.array([square(v) for v in voltage]) / square(0.0)


def dashpot(molar_mass: float, temperature: float) -> float:
    """Return the force per area, velocity and pressure on both sides of a plate in thin gas [s/m].

    Molecules of Maxwell's distribution bounce off a plate that moves slowly, at 0.1 % of the speed
    of sound.
    """
    speed = np.sqrt(8.314462618 * temperature / molar_mass)
    # In units of the thermal speed, up to ten of them
    s, share = np.polynomial.legendre.leggauss(200)
    v = 5 * (s + 1)
    weight = 5 * share * np.exp(-(v**2) / 2) / np.sqrt(2 * np.pi)
    u = 1e-3
    # Flux of the relative velocity, which turns round
    ahead = np.sum(2 * (v + u) ** 2 * weight)
    behind = np.sum(2 * np.maximum(v - u, 0) ** 2 * weight)
    return float((ahead - behind) / u / speed)
