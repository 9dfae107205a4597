"""How far the edge of a released film moves in its plane.

Plane strain of the film's end on the oxide that the etch left, matched to the wafer's half-space.

The film lies on oxide with a steep face, on silicon. Before the etch nothing pulls sideways;
afterwards the suspended film pulls at its end, the film on the ledge pulls back, and the oxide,
compressed since it grew, expands towards the gap.

A line force F per length moves a half-plane by −K F ln r, K = 2 (1 − ν²)/(π E), which has no limit.
So the cross-section gives only what the layers add to that logarithm. It is solved with the line's
own field on its far boundary, where it is exact up to the ratio of the layers to the box. Side and
corners of the film set the logarithm: see `benchmarks.ledge_wafer`.

Source: S. Timoshenko, J. Goodier, Theory of Elasticity, 3rd ed., art. 36 (force on a half-plane).
Limits: linear, isotropic. `tests/physics/test_ledge.py` holds boxes and elements to 0.02 nm.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix
from skfem import (
    Basis,
    BilinearForm,
    ElementQuad0,
    ElementQuad2,
    ElementVector,
    FacetBasis,
    Functional,
    LinearForm,
    MeshQuad,
)
from skfem.assembly.form.form import FormExtraParams
from skfem.element import DiscreteField
from skfem.helpers import ddot, sym_grad, trace

from femnl.mechanics.fem.solvers import factorize

Array = NDArray[np.float64]

OXIDE = 3.17e-6  # thickness, arXiv:2502.19191, supplement S1
REACH = 10e-6  # of the etch, the same
# An isotropic etch is a quarter of a circle, which at the silicon lies this far behind.
FOOT = REACH - float(np.sqrt(REACH**2 - OXIDE**2))
FAR = 2e-3  # from the edge to the boundary of the cross-section
GROWTH = 1.25


@dataclass(frozen=True)
class Materials:
    """Young's moduli [Pa] and Poisson's ratios of film, oxide and silicon."""

    young: tuple[float, float, float] = (250e9, 70e9, 160e9)
    poisson: tuple[float, float, float] = (0.23, 0.17, 0.22)

    @property
    def logarithm(self) -> float:
        """K [m²/N] of the silicon: how a line force per length displaces it by −K F ln r."""
        return 2 * (1 - self.poisson[2] ** 2) / (np.pi * self.young[2])


USUAL = Materials()


@dataclass(frozen=True)
class Ledge:
    """How the film's end moves by a pull on it, and by compressed oxide.

    pull [m²/N], push [m/Pa]: the displacement inwards by a unit force per length on the end, and by
    a unit of pressure in the oxide, of which the line's −K F ln(r/1 m) is taken off.
    """

    pull: float
    push: float
    thickness: float
    materials: Materials = USUAL

    def springs(self, length: float) -> tuple[float, float]:
        """Return normal and shear [Pa] of a ledge whose logarithm ends at a length [m].

        Along the edge, √(G h · G'/t) of a film on a layer that shears.
        """
        normal = 1 / (self.pull + self.materials.logarithm * np.log(length))
        film = self.materials.young[0] / 2 / (1 + self.materials.poisson[0])
        ratio = film * (1 - self.materials.poisson[0] ** 2) / self.materials.young[0]
        return normal, normal * float(np.sqrt(ratio))


def solve_ledge(
    thickness: float,
    layers: int = 4,
    far: float = FAR,
    foot: float = FOOT,
    oxide: float = OXIDE,
    materials: Materials = USUAL,
) -> Ledge:
    """Solve the cross-section.

    Args: thickness of the film on the ledge [m]; layers of elements across it; far, half the width
    and the depth of the box [m]; foot, how far the oxide reaches into the gap at the silicon [m];
    oxide, its thickness [m].
    """
    mesh, material = _cross_section(thickness, layers, far, foot, oxide)
    basis = Basis(mesh, ElementVector(ElementQuad2()), intorder=4)
    constant = basis.with_element(ElementQuad0())
    young = np.array(materials.young)[material]
    poisson = np.array(materials.poisson)[material]
    lame = constant.interpolate(young * poisson / (1 + poisson) / (1 - 2 * poisson))
    shear = constant.interpolate(young / 2 / (1 + poisson))
    matrix = _stiffness.assemble(basis, lame=lame, shear=shear)
    end = FacetBasis(
        mesh,
        basis.elem,
        facets=mesh.facets_satisfying(
            lambda p: (np.abs(p[0]) < 1e-12) & (p[1] > 0), boundaries_only=True
        ),
    )
    pull = LinearForm(lambda v, w: -v[0] / thickness).assemble(end)
    # stress −1 Pa of the oxide, so its work in a virtual strain is +ε_xx
    within = constant.interpolate((material == 1).astype(float))
    push = LinearForm(lambda v, w: w.oxide * sym_grad(v)[0, 0]).assemble(basis, oxide=within)
    held = basis.get_dofs(
        lambda p: (np.abs(p[0]) > far * (1 - 1e-9)) | (p[1] < -oxide - far * (1 - 1e-9))
    ).all()
    free = np.setdiff1d(np.arange(basis.N), held)
    solve = factorize(csc_matrix(matrix[free][:, free]))
    along = basis.doflocs[:, held]
    moved = []
    for load, force in ((pull, 1.0), (push, oxide)):
        displacement = np.zeros(basis.N)
        field = force * line_force(along[0], np.minimum(along[1] + oxide, 0.0), materials)
        displacement[held] = np.where(_is_x(basis)[held], field[0], field[1])
        displacement[free] = solve((load - matrix @ displacement)[free])
        at_end = end.interpolate(displacement)
        moved.append(-float(Functional(lambda w: w.u[0]).assemble(end, u=at_end)) / thickness)
    return Ledge(moved[0], moved[1], thickness, materials)


def line_force(x: Array, y: Array, materials: Materials = USUAL) -> Array:
    """Displacement (2, n) of the silicon y ≤ 0 [m²/N] by a unit force per length towards −x.

    Timoshenko and Goodier, art. 36, in plane strain, with no constant of its own.
    """
    radius = np.hypot(x, y)
    angle = np.arctan2(y, -x)  # from the force, 0 … −π
    poisson = materials.poisson[2] / (1 - materials.poisson[2])
    turned = (1 - poisson) / 2 * (angle + np.pi / 2)
    radial = -np.cos(angle) * np.log(radius) - turned * np.sin(angle)
    around = np.sin(angle) * (np.log(radius) + (1 + poisson) / 2) - turned * np.cos(angle)
    inwards = radial * np.cos(angle) - around * np.sin(angle)
    up = radial * np.sin(angle) + around * np.cos(angle)
    return materials.logarithm * np.stack([-inwards, up])


@BilinearForm
def _stiffness(u: DiscreteField, v: DiscreteField, w: FormExtraParams) -> Array:
    volume = w.lame * trace(sym_grad(u)) * trace(sym_grad(v))
    return np.asarray(volume + 2 * w.shear * ddot(sym_grad(u), sym_grad(v)))


def _cross_section(
    thickness: float, layers: int, far: float, foot: float, oxide: float
) -> tuple[MeshQuad, NDArray[np.int64]]:
    """Mesh of film (0), oxide (1) and silicon (2), and which element is which."""
    step = thickness / layers
    y = np.concatenate(
        [
            np.linspace(0, thickness, layers + 1),
            -oxide + graded(oxide / 2, step),
            -graded(oxide / 2, step),
            -oxide - graded(far, step),
        ]
    )
    x = np.concatenate([-graded(far, step), graded(far, step)])
    mesh = MeshQuad.init_tensor(np.unique(x), np.unique(np.round(y, 15)))
    middle = mesh.p[:, mesh.t].mean(axis=1)
    mesh = mesh.restrict(np.flatnonzero((middle[1] < -oxide) | (middle[0] > 0)))
    middle = mesh.p[:, mesh.t].mean(axis=1)
    material = np.where(middle[1] > 0, 0, np.where(middle[1] > -oxide, 1, 2))
    # the face leans over the foot, and what lies below and beside it goes along
    depth = np.clip(-mesh.p[1] / oxide, 0, 1)
    lean = foot * depth * np.exp(np.minimum(mesh.p[1] + oxide, 0) / oxide)
    moved = mesh.p - np.stack([lean * np.exp(-np.abs(mesh.p[0]) / oxide), np.zeros_like(lean)])
    return MeshQuad(moved, mesh.t), material


def _is_x(basis: Basis) -> NDArray[np.bool_]:
    """Whether a degree of freedom is one of u_x."""
    found = np.zeros(basis.N, dtype=bool)
    found[basis.split_indices()[0]] = True
    return found


def graded(length: float, step: float, growth: float = GROWTH) -> Array:
    """Places from 0 to a length, `step` apart at 0 and ever further."""
    places = np.concatenate([[0.0], np.cumsum(step * growth ** np.arange(200))])
    places = places[: np.searchsorted(places, length) + 1]
    return np.asarray(places * length / places[-1])
