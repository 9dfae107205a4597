"""Films whose stress is a bowl, relaxed in their plane: a disc and a square."""

from collections.abc import Iterator

import numpy as np
from scipy.special import jn_zeros, jv, jvp

from femnl.device import geometry
from femnl.device.mesh import mesh
from femnl.mechanics.modes import solve_modes
from femnl.mechanics.modes.projection import project
from femnl.mechanics.prestress import solve_prestress, solve_units
from femnl.validation import Case, Reference

POISSON = 0.23
GEOMETRY = """
name = "bowl"
source = "a film of σ = 1 GPa whose stress varies as x² + y²"
[outline]
{outline}
[film]
thickness = "50 nm"
young = "250 GPa"
poisson = 0.23
density = "3100 kg/m^3"
stress = "1 GPa"
[model]
bending = false
"""
CIRCLE = 'kind = "circle"\ndiameter = "2 m"'
SQUARE = 'kind = "square"\nside = "2 m"'
ORDERS = ((0, 0), (1, 1), (2, 3))
"""Nodal diameters of a disc's modes, and the rank of each."""


def shares(outline: str, ranks: tuple[int, ...]) -> list[float]:
    """∫ S : ∇ξ∇ξ / ∫ |∇ξ|² of modes, S what is left of the stress x² + y² [R²]."""
    model = geometry.parse(GEOMETRY.format(outline=outline))
    modes = solve_modes(solve_prestress(mesh(model, "quarter"), 3), 6, 4)
    slopes = project(modes, solve_units(modes.domain, 3)).slopes
    bowl = np.diag(slopes[[3, 5], :2].sum(axis=(0, 1)))
    even = np.diag(slopes[0, :2].sum(axis=0))
    return [float(bowl[rank] / even[rank]) for rank in ranks]


def disc(order: int) -> float:
    """The same of a disc, in closed form: what a mode has of σ_r and of σ_θ."""
    zero = jn_zeros(order, 1)[0]
    x, w = np.polynomial.legendre.leggauss(40)
    r = (x + 1) / 2
    radial = r * w * (zero * jvp(order, zero * r)) ** 2
    around = r * w * (order * jv(order, zero * r) / r) ** 2
    across = (1 + POISSON + (1 - POISSON) * r**2) / 4
    along = (1 + POISSON + 3 * (1 - POISSON) * r**2) / 4
    return float(np.sum(across * radial + along * around) / np.sum(radial + around))


def compute() -> Iterator[float]:
    """Yield the disc's modes, and (2,1) less (1,1) of the square."""
    yield from shares(CIRCLE, tuple(rank for _, rank in ORDERS))
    first, second = shares(SQUARE, (0, 1))
    yield second - first


CASE = Case(
    claim="A film stress that varies as a bowl relaxes in the plane as closed forms and "
    "polynomials say",
    source="disc: Lamé's equation with the film stress as eigenstrain (Timoshenko & Goodier, "
    "Theory of Elasticity, 1951, chapter 14), σ_r = ¼(1 + ν + (1 − ν)r²), σ_θ = ¼(1 + ν + 3(1 − ν)"
    "r²); square: Ritz with 16² polynomials (1 − x²)(1 − y²) P_k P_l for the plane and sines for "
    "the modes, converged to 2e-8; unrelaxed it would be −0.0912",
    references=(
        *(
            Reference(f"share of the bowl, {order} nodal diameters", disc(order), relative=1e-5)
            for order, _ in ORDERS
        ),
        Reference("share of the bowl, (2,1) less (1,1) of a square", 0.025056, relative=1e-4),
    ),
    compute=compute,
)
