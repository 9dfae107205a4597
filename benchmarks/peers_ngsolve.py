"""The perforated film with NGSolve, tuned: a quarter of it, its fastest way to such a geometry, the cheapest size and order that do.

Its sparse Cholesky solver serves scipy's eigsh, because its own Arnoldi iteration gave wrong high modes. Bending is a C⁰ interior penalty
form as its documentation has it.
"""

from importlib import import_module
from itertools import product
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, eigsh

from femnl.types.device import Model

Array = NDArray[np.float64]

UNIT = 1e6
# Largest element (µm), grading and order. Of the membrane the cheapest that leaves 1e-5 of the first six ratios, of 4 and 8 µm, gradings
# 0.5 and 0.9 and orders 2 and 3. Of the plate the cheapest tried, which leaves 5e-5; finer ones take minutes.
MEMBRANE, PLATE = (8.0, 0.5, 2), (8.0, 0.9, 3)


def solve(model: Model, count: int) -> list[float]:
    """Ratios f/f₁."""
    ng, film = import_module("ngsolve"), model.film
    size, grading, order = PLATE if model.bending else MEMBRANE
    mesh = ng.Mesh(_geometry(model).GenerateMesh(maxh=size, grading=grading))
    mesh.Curve(order)
    young, nu = film.young / film.stress / (1 - film.poisson**2), film.poisson

    def stress(strain: Any) -> Any:
        return young * ((1 - nu) * strain + nu * ng.Trace(strain) * ng.Id(2))

    plane = ng.VectorH1(mesh, order=order, dirichletx="edge|mirror_x", dirichlety="edge|mirror_y")
    u, v = plane.TnT()
    stiffness = ng.BilinearForm(ng.InnerProduct(stress(ng.Sym(ng.Grad(u))), ng.Sym(ng.Grad(v))) * ng.dx, symmetric=True).Assemble()
    load = ng.LinearForm(-ng.Trace(ng.Grad(v)) * ng.dx).Assemble()
    moved = ng.GridFunction(plane)
    moved.vec.data = stiffness.mat.Inverse(plane.FreeDofs(), inverse="sparsecholesky") * load.vec
    tension = ng.Id(2) + stress(ng.Sym(ng.Grad(moved)))

    squares: list[float] = []
    for odd_x, odd_y in product((False, True), repeat=2):
        held = "edge" + "|mirror_x" * odd_x + "|mirror_y" * odd_y
        still = "edge" + "|mirror_x" * (not odd_x) + "|mirror_y" * (not odd_y)
        space = ng.H1(mesh, order=order, dirichlet=held, dgjumps=model.bending)
        w, z = space.TnT()
        k = ng.BilinearForm(space, symmetric=True)
        k += ng.InnerProduct(tension * ng.grad(w), ng.grad(z)) * ng.dx
        if model.bending:
            _add_bending(k, w, z, film.young * film.thickness**2 / 12 / (1 - nu**2) / film.stress * UNIT**2, nu, mesh.Boundaries(still))
        k.Assemble()
        m = ng.BilinearForm(w * z * ng.dx, symmetric=True).Assemble()
        squares += _lowest(k.mat, m.mat, space.FreeDofs(), count // 2)
    return [float(r) for r in np.sqrt(np.sort(squares)[:count] / np.min(squares))]


def _geometry(model: Model) -> Any:
    """The quarter x > 0, y > 0."""
    shapes, half, radius = import_module("netgen.geom2d"), model.outline.length / 2 * UNIT, model.holes.radius * UNIT
    names = {"left": "mirror_x", "bottom": "mirror_y", "right": "edge", "top": "edge"}
    film = shapes.Rectangle(pmin=(0, 0), pmax=(half, half), **names)
    for x, y in model.holes.centres * UNIT:
        if min(x, y) > -radius:
            film = film - shapes.Circle(center=(x, y), radius=radius, bc="hole")
    geometry = shapes.CSG2d()
    geometry.Add(film)
    return geometry


def _add_bending(form: Any, w: Any, z: Any, rigidity: float, nu: float, still: Any) -> None:
    """D [(1−ν)∇∇w:∇∇z + νΔwΔz] and what joins slopes across edges, or holds them where they are zero."""
    ng = import_module("ngsolve")
    normal, size, order = ng.specialcf.normal(2), ng.specialcf.mesh_size, form.space.globalorder
    penalty = 3 * order**2 * rigidity / size

    def moment(f: Any) -> Any:
        hesse = f.Operator("hesse")
        return rigidity * ((1 - nu) * hesse + nu * ng.Trace(hesse) * ng.Id(2))

    def across(f: Any) -> Any:
        return ng.InnerProduct(moment(f) * normal, normal)

    def mean(f: Any) -> Any:
        return (across(f) + across(f.Other())) / 2

    def jump(f: Any) -> Any:
        return (ng.grad(f) - ng.grad(f.Other())) * normal

    def turn(f: Any) -> Any:
        return ng.grad(f) * normal

    form += ng.InnerProduct(moment(w), z.Operator("hesse")) * ng.dx
    form += (-mean(w) * jump(z) - mean(z) * jump(w) + penalty * jump(w) * jump(z)) * ng.dx(skeleton=True)
    form += (-across(w) * turn(z) - across(z) * turn(w) + 2 * penalty * turn(w) * turn(z)) * ng.ds(skeleton=True, definedon=still)


def _lowest(stiffness: Any, mass: Any, free_dofs: Any, count: int) -> list[float]:
    free = np.flatnonzero(np.array(list(free_dofs), dtype=bool))
    inverse = stiffness.Inverse(free_dofs, inverse="sparsecholesky")
    right, left = stiffness.CreateColVector(), stiffness.CreateColVector()

    def matrix(form: Any) -> Any:
        rows, columns, values = form.COO()
        lower = sp.coo_matrix((np.array(values), (np.array(rows), np.array(columns)))).tocsr()
        whole = lower + lower.T - sp.diags(lower.diagonal()) if sp.triu(lower, 1).nnz == 0 else lower
        return whole[free][:, free]

    def apply(x: Array) -> Array:
        right.FV().NumPy()[:] = 0
        right.FV().NumPy()[free] = x.ravel()
        left.data = inverse * right
        return np.array(left.FV().NumPy()[free])

    stiff, heavy = matrix(stiffness), matrix(mass)
    inverse_k = LinearOperator(stiff.shape, matvec=apply, dtype=float)
    return list(eigsh(stiff, k=count, M=heavy, sigma=0.0, OPinv=inverse_k, return_eigenvectors=False))
