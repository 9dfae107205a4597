"""Film stress in equilibrium on a rectangle, by Legendre polynomials of both displacements.

Over the whole film at once, without elements; Young's modulus 1, which does not count between edges
that are rigid or whose springs are in units of it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial.legendre import Legendre, leggauss
from scipy.linalg import eigh

from tests.blind.lab.bench import Array

TERMS = 18
SMOOTH_TERMS = 12
"""Polynomials along each side, between springs and between rigid edges."""
MODE_TERMS = 14
"""Polynomials along each side of one parity, for the modes on an edge that yields."""
POINTS = 72

Sides = tuple[float, float]
GRADED: tuple[Callable[[Array, Array], Array], ...] = (
    lambda x, y: x + 0 * y,
    lambda x, y: y + 0 * x,
    lambda x, y: x**2 + y**2,
)
"""Stresses before they relax, in units of length."""


def _rows(t: Array, terms: int, held: bool) -> tuple[Array, Array]:
    """Polynomials (terms, n) and their slopes at t in [−1, 1]; held: they vanish at both ends."""
    bubble = Legendre([2 / 3, 0, -2 / 3]) if held else Legendre([1.0])
    found = [Legendre.basis(k) * bubble for k in range(terms)]
    return np.array([p(t) for p in found]), np.array([p.deriv()(t) for p in found])


@dataclass(frozen=True)
class Stress:
    """A relaxed stress: its coefficients and what it was before."""

    sides: Sides
    poisson: float
    held: bool
    before: Callable[[Array, Array], Array]
    moved: Array

    def at(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Return xx, yy, xy (n, m) at x (n,) and y (m,) from the middle."""
        half = np.array(self.sides) / 2
        value, slope = zip(
            *(
                _rows(p / h, self.moved.shape[1], self.held)
                for p, h in zip((x, y), half, strict=True)
            ),
            strict=True,
        )
        u, v = self.moved
        nu = self.poisson
        across = slope[0].T @ u @ value[1] / half[0]
        along = value[0].T @ v @ slope[1] / half[1]
        sheared = value[0].T @ u @ slope[1] / half[1] + slope[0].T @ v @ value[1] / half[0]
        own = self.before(x[:, None], y[None, :]) * np.ones((len(x), len(y)))
        stiff = 1 / (1 - nu**2)
        return (
            own + stiff * (across + nu * along),
            own + stiff * (along + nu * across),
            sheared / (2 * (1 + nu)),
        )


def _solve(
    sides: Sides, poisson: float, springs: tuple[float, float] | None, kind: int | None
) -> Stress:
    """Minimise ∫ ½ ε : C ε + s tr ε + ∮ ½ (kₙ uₙ² + kₜ uₜ²); no springs: u = 0 at the edge."""
    before = GRADED[kind] if kind is not None else (lambda x, y: 1.0 + 0 * x * y)
    held = springs is None
    half = np.array(sides) / 2
    t, w = leggauss(POINTS)
    terms = SMOOTH_TERMS if held else TERMS
    value, slope = _rows(t, terms, held)
    ends, _ = _rows(np.array([-1.0, 1.0]), terms, held)
    mass, stiff, mixed = (value * w) @ value.T, (slope * w) @ slope.T, (slope * w) @ value.T
    edge = ends @ ends.T
    a, b = half
    modulus, shear = 1 / (1 - poisson**2), 1 / (2 * (1 + poisson))
    xx, yy = np.kron(stiff, mass) * b / a, np.kron(mass, stiff) * a / b
    own = [modulus * xx + shear * yy, modulus * yy + shear * xx]
    if springs is not None:
        normal, along = springs
        left, top = np.kron(edge, mass) * b, np.kron(mass, edge) * a
        own = [own[0] + normal * left + along * top, own[1] + along * left + normal * top]
    cross = modulus * poisson * np.kron(mixed, mixed.T) + shear * np.kron(mixed.T, mixed)
    pull = np.outer(w, w) * before(a * t[:, None], b * t[None, :])
    load = np.concatenate(
        [(slope @ pull @ value.T).ravel() * b, (value @ pull @ slope.T).ravel() * a]
    )
    moved = np.linalg.solve(np.block([[own[0], cross], [cross.T, own[1]]]), -load)
    return Stress(sides, poisson, held, before, moved.reshape(2, terms, terms))


@cache
def graded(sides: Sides, poisson: float, kind: int) -> Stress:
    """One of `GRADED`, relaxed between rigid edges."""
    return _solve(sides, poisson, None, kind)


def pulled(sides: Sides, inner: Sides, poisson: float, basis: int) -> Array:
    """∫ S : ∇ξᵢ∇ξⱼ / area of the sines of the inner rectangle, for each of `GRADED`, (3, n, n)."""
    t, w = leggauss(POINTS)
    half = np.array(inner) / 2
    m = np.pi / 2 * np.arange(1, basis + 1)
    value = np.asarray(np.sin(np.outer(m, t + 1)), float)
    slope = np.asarray(m[:, None] * np.cos(np.outer(m, t + 1)), float)
    found = []
    for kind in range(len(GRADED)):
        xx, yy, xy = graded(sides, poisson, kind).at(half[0] * t, half[1] * t)
        area = np.outer(w, w)
        mixed = tensor(area * xy, slope, value, value, slope) / (half[0] * half[1])
        found.append(
            tensor(area * xx, slope, value, slope, value) / half[0] ** 2
            + tensor(area * yy, value, slope, value, slope) / half[1] ** 2
            + mixed
            + mixed.T
        )
    return np.array(found)


@cache
def yielding(sides: Sides, poisson: float, compliance: float) -> Stress:
    """A stress of 1 between springs 1/λ across the edge and (1 − ν)/2λ along it."""
    return _solve(sides, poisson, (1 / compliance, (1 - poisson) / 2 / compliance), None)


@cache
def yielded_modes(
    sides: Sides, inner: Sides, poisson: float, compliance: float, orders: tuple[int, int]
) -> tuple[Array, Array]:
    """k² and overlaps with sines (m, n, mode) of the modes of a membrane under such a stress.

    The membrane is the inner rectangle of the film. By polynomials again, each parity apart.
    """
    t, w = leggauss(POINTS)
    a, b = np.array(inner) / 2
    stress = yielding(sides, poisson, compliance).at(a * t, b * t)
    value, slope = _rows(t, 2 * MODE_TERMS, True)
    squares, overlaps = [], []
    for px in (0, 1):
        for py in (0, 1):
            vx, dx, vy, dy = value[px::2], slope[px::2], value[py::2], slope[py::2]
            stiff = np.zeros((MODE_TERMS**2, MODE_TERMS**2))
            for field, rows in zip(
                (stress[0] * b / a, stress[1] * a / b, stress[2]),
                ((dx, vy, dx, vy), (vx, dy, vx, dy), (dx, vy, vx, dy)),
                strict=True,
            ):
                part = tensor(field * np.outer(w, w), *rows)
                stiff += part if rows[0] is rows[2] else part + part.T
            heavy = np.kron((vx * w) @ vx.T, (vy * w) @ vy.T) * a * b
            square, vectors = eigh(stiff, heavy)
            m, n = orders
            sx, sy = (np.sin(np.outer(np.arange(1, k + 1), np.pi * (t + 1) / 2)) for k in (m, n))
            # Of sines with ∫ φ² = 1 over the inner rectangle
            over = np.einsum(
                "mi,nj,ijk->mnk",
                (sx * w) @ vx.T,
                (sy * w) @ vy.T,
                vectors.reshape(MODE_TERMS, MODE_TERMS, -1),
            ) * np.sqrt(a * b)
            squares.append(square)
            overlaps.append(over)
    return np.concatenate(squares), np.concatenate(overlaps, axis=2)


@cache
def layer_pull(sides: Sides, inner: Sides, poisson: float, compliance: float, basis: int) -> Array:
    """What the clamped layer adds to k² between sines with ∫ φ² = 1, per ℓ, (mn, mn).

    Where the stress S across the edge is less, the layer √(D/S) is thicker and the membrane
    smaller: ∮ (S^−½ − 1) S ∂ₙφ ∂ₙφ′ ds by Hadamard's formula for a moved boundary.
    """
    t, w = leggauss(POINTS)
    order = np.arange(1, basis + 1)
    sines = np.sin(np.outer(order, np.pi * (t + 1) / 2))
    both = np.outer(order, order) * (1 + (-1.0) ** np.add.outer(order, order))
    stress = yielding(sides, poisson, compliance)
    # What the springs say converges faster than the stress of polynomials at their ends
    value, _ = _rows(t, stress.moved.shape[1], stress.held)
    end, _ = _rows(np.ones(1), stress.moved.shape[1], stress.held)
    across = -(end.T @ stress.moved[0] @ value).ravel() / compliance
    along = -(value.T @ stress.moved[1] @ end).ravel() / compliance
    found = np.zeros((basis**2, basis**2))
    for pull, width, is_x in ((across, inner[0], True), (along, inner[1], False)):
        slopes = both * 2 * np.pi**2 / width**3
        beside = (sines * w * (np.sqrt(pull) - pull)) @ sines.T
        found += np.kron(slopes, beside) if is_x else np.kron(beside, slopes)
    return found


def tensor(field: Array, ax: Array, ay: Array, bx: Array, by: Array) -> Array:
    """∫ field aₓ a_y bₓ b_y of products of rows, (n_x n_y, n_x n_y); weights are in the field."""
    n, m = len(ax), len(ay)
    across = (ax[:, None] * bx).reshape(n * n, -1)
    along = (ay[:, None] * by).reshape(m * m, -1)
    found = across @ field @ along.T
    return np.asarray(found.reshape(n, n, m, m).transpose(0, 2, 1, 3).reshape(n * m, n * m))
