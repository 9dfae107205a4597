"""The perforated membrane with NGSolve: its mesher, curved cubic elements, its sparse Cholesky solver inside scipy's eigsh."""

from importlib import import_module
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, eigsh

from femnl.types.device import Model

Array = NDArray[np.float64]

ORDER = 3


def solve(model: Model, count: int) -> list[float]:
    """Ratios f/f₁."""
    occ, ng = import_module("netgen.occ"), import_module("ngsolve")
    film, unit = model.film, 1e6
    side, radius = model.outline.length * unit, model.holes.radius * unit
    square = occ.Rectangle(side, side).Face().Move((-side / 2, -side / 2, 0))
    square.edges.name = "edge"
    face = square - occ.Compound([occ.Circle((x * unit, y * unit), radius).Face() for x, y in model.holes.centres])
    mesh = ng.Mesh(occ.OCCGeometry(face, dim=2).GenerateMesh(maxh=4.0, grading=0.5))
    mesh.Curve(ORDER)
    young, nu = film.young / film.stress / (1 - film.poisson**2), film.poisson

    plane = ng.VectorH1(mesh, order=ORDER, dirichlet="edge")
    u, v = plane.TnT()

    def stress(strain: Any) -> Any:
        return young * ((1 - nu) * strain + nu * ng.Trace(strain) * ng.Id(2))

    stiffness = ng.BilinearForm(ng.InnerProduct(stress(ng.Sym(ng.Grad(u))), ng.Sym(ng.Grad(v))) * ng.dx, symmetric=True).Assemble()
    load = ng.LinearForm(-ng.Trace(ng.Grad(v)) * ng.dx).Assemble()
    moved = ng.GridFunction(plane)
    moved.vec.data = stiffness.mat.Inverse(plane.FreeDofs(), inverse="sparsecholesky") * load.vec
    tension = ng.Id(2) + stress(ng.Sym(ng.Grad(moved)))

    flexure = ng.H1(mesh, order=ORDER, dirichlet="edge")
    w, z = flexure.TnT()
    k = ng.BilinearForm(ng.InnerProduct(tension * ng.grad(w), ng.grad(z)) * ng.dx, symmetric=True).Assemble()
    m = ng.BilinearForm(w * z * ng.dx, symmetric=True).Assemble()
    inverse = k.mat.Inverse(flexure.FreeDofs(), inverse="sparsecholesky")
    right, left = k.mat.CreateColVector(), k.mat.CreateColVector()
    free = np.flatnonzero(np.array(list(flexure.FreeDofs()), dtype=bool))

    def matrix(form: Any) -> Any:
        rows, columns, values = form.mat.COO()
        lower = sp.coo_matrix((np.array(values), (np.array(rows), np.array(columns)))).tocsr()
        whole = lower + lower.T - sp.diags(lower.diagonal()) if sp.triu(lower, 1).nnz == 0 else lower
        return whole[free][:, free]

    def apply(x: Array) -> Array:
        right.FV().NumPy()[:] = 0
        right.FV().NumPy()[free] = x.ravel()
        left.data = inverse * right
        return np.array(left.FV().NumPy()[free])

    stiff, heavy = matrix(k), matrix(m)
    squares = eigsh(
        stiff, k=count, M=heavy, sigma=0.0, OPinv=LinearOperator(stiff.shape, matvec=apply, dtype=float), return_eigenvectors=False
    )
    return [float(r) for r in np.sqrt(np.sort(squares) / np.min(squares))]
