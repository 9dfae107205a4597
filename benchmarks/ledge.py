"""How far the edge of a released film moves in its plane.

Plane strain of the film's end on the oxide that the etch left.

The film lies on oxide with a vertical face, on silicon. Before the etch nothing pulls sideways;
afterwards the suspended film pulls at its end, the film on the ledge pulls back, and the oxide,
compressed since it grew, expands towards the gap.
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
from skfem.helpers import ddot, sym_grad, trace

from femnl.mechanics.fem.solvers import factorize

Array = NDArray[np.float64]

YOUNG = np.array([250e9, 70e9, 160e9])  # film, oxide, silicon
POISSON = np.array([0.23, 0.17, 0.22])
OXIDE = 3.17e-6  # thickness, arXiv:2502.19191, supplement S1
WIDE = 30e-6
DEEP = 30e-6
GROWTH = 1.25


@dataclass(frozen=True)
class Ledge:
    """normal [Pa]: force per length and displacement at the film's end.

    relaxation [m/Pa]: how far compressed oxide pushes it inwards.
    """

    normal: float
    relaxation: float

    @property
    def shear(self) -> float:
        """The same along the edge [Pa], √(G h · G'/t) of a film on a layer that shears."""
        film = YOUNG[0] / 2 / (1 + POISSON[0])
        return self.normal * float(np.sqrt(film * (1 - POISSON[0] ** 2) / YOUNG[0]))


def solve_ledge(thickness: float, layers: int = 4) -> Ledge:
    """Solve the cross-section.

    Args: thickness of the film on the ledge [m]; layers of elements across it.
    """
    step = thickness / layers
    across = np.concatenate(
        [
            np.linspace(0, thickness, layers + 1),
            -OXIDE + _graded(OXIDE / 2, step),
            -_graded(OXIDE / 2, step),
        ]
    )
    x = np.concatenate([-_graded(2 / 3 * WIDE, step), _graded(WIDE, step)])
    y = np.concatenate([across, -OXIDE - _graded(DEEP, step)])
    mesh = MeshQuad.init_tensor(np.unique(x), np.unique(np.round(y, 15)))
    middle = mesh.p[:, mesh.t].mean(axis=1)
    mesh = mesh.restrict(np.flatnonzero((middle[1] < -OXIDE) | (middle[0] > 0)))
    middle = mesh.p[:, mesh.t].mean(axis=1)
    material = np.where(middle[1] > 0, 0, np.where(middle[1] > -OXIDE, 1, 2))
    basis = Basis(mesh, ElementVector(ElementQuad2()), intorder=4)
    constant = basis.with_element(ElementQuad0())
    young = YOUNG[material]
    poisson = POISSON[material]
    lame = constant.interpolate(young * poisson / (1 + poisson) / (1 - 2 * poisson))
    shear = constant.interpolate(young / 2 / (1 + poisson))

    stiffness = BilinearForm(
        lambda u, v, w: (
            w.lame * trace(sym_grad(u)) * trace(sym_grad(v))
            + 2 * w.shear * ddot(sym_grad(u), sym_grad(v))
        )
    )
    compressed = LinearForm(lambda v, w: w.oxide * sym_grad(v)[0, 0])
    end = FacetBasis(
        mesh,
        basis.elem,
        facets=mesh.facets_satisfying(
            lambda p: (np.abs(p[0]) < 1e-12) & (p[1] > 0), boundaries_only=True
        ),
    )
    pull = LinearForm(lambda v, w: -v[0] / thickness).assemble(end)
    sides = basis.get_dofs(lambda p: (p[0] > WIDE - 1e-12) | (p[0] < -2 / 3 * WIDE + 1e-12)).all(
        "u^1"
    )
    held = np.union1d(sides, basis.get_dofs(lambda p: p[1] < mesh.p[1].min() + 1e-12).all())
    free = np.setdiff1d(np.arange(basis.N), held)
    matrix = stiffness.assemble(basis, lame=lame, shear=shear)
    result = factorize(csc_matrix(matrix[free][:, free]))
    oxide = compressed.assemble(basis, oxide=constant.interpolate((material == 1).astype(float)))
    moved = []
    for load in (pull, oxide):
        displacement = np.zeros(basis.N)
        displacement[free] = result(load[free])
        moved.append(
            -float(Functional(lambda w: w.u[0]).assemble(end, u=end.interpolate(displacement)))
            / thickness
        )
    return Ledge(1 / moved[0], moved[1])


def _graded(length: float, step: float) -> Array:
    """Places from 0 to a length, `step` apart at 0 and ever further."""
    places = np.concatenate([[0.0], np.cumsum(step * GROWTH ** np.arange(200))])
    places = places[: np.searchsorted(places, length) + 1]
    return np.asarray(places * length / places[-1])
