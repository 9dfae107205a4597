"""The perforated film with NGSolve, tuned.

a quarter of it, its fastest way to such a geometry, the cheapest size and order found.

Its sparse Cholesky solver serves scipy's eigsh, because its own Arnoldi iteration gave wrong high
modes. Bending is its own plate element, that of Hellan, Herrmann and Johnson: moments with
continuous normal component, here joined by slopes on the edges of triangles, so that they are
eliminated in each (J. Pechstein and J. Schöberl, Numer. Math. 137, 713 (2017)).
"""

from importlib import import_module
from itertools import product
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, eigsh

from femnl.core.device import Model

Array = NDArray[np.float64]

UNIT = 1e6
# Largest element (µm), grading and order: the cheapest tried that leave 1e-5 of the first six
# ratios. Of the membrane 4 and 8 µm, gradings 0.5 and 0.9 and orders 2 and 3 were tried; of the
# plate, grading 0.9 and orders 3, which leaves 4e-5, and 4. On 64 holes finer gradings of the plate
# (0.5 and 0.3) and order 5 cost more for what they leave.
MEMBRANE = (8.0, 0.5, 2)
PLATE = (8.0, 0.9, 4)


def solve(model: Model, count: int) -> list[float]:
    """Ratios f/f₁."""
    ng = import_module("ngsolve")
    film = model.film
    size, grading, order = PLATE if model.bending else MEMBRANE
    mesh = ng.Mesh(_geometry(model).GenerateMesh(maxh=size, grading=grading))
    mesh.Curve(order)
    nu = film.poisson
    tension = relaxed_tension(mesh, model, order, "edge|mirror_x", "edge|mirror_y")

    squares: list[float] = []
    for odd_x, odd_y in product((False, True), repeat=2):
        held = "edge" + "|mirror_x" * odd_x + "|mirror_y" * odd_y
        still = "edge" + "|mirror_x" * (not odd_x) + "|mirror_y" * (not odd_y)
        space = ng.H1(mesh, order=order, dirichlet=held)
        w, z = space.TnT()
        mass = ng.BilinearForm(w * z * ng.dx, symmetric=True).Assemble()
        if model.bending:
            inverse = plate(space, tension, rigidity(model), nu, still)
        else:
            form = ng.BilinearForm(
                ng.InnerProduct(tension * ng.grad(w), ng.grad(z)) * ng.dx, symmetric=True
            ).Assemble()
            inverse = form.mat.Inverse(space.FreeDofs(), inverse="sparsecholesky")
        squares += lowest(inverse, mass.mat, space.FreeDofs(), count // 2)
    return [float(r) for r in np.sqrt(np.sort(squares)[:count] / np.min(squares))]


def relaxed_tension(mesh: Any, model: Model, order: int, held_x: str, held_y: str) -> Any:
    """The tension over σ₀ after release.

    held_x, held_y: names of the edges on which the displacement along x and along y is zero.
    """
    ng = import_module("ngsolve")
    film = model.film
    nu = film.poisson
    young = film.young / film.stress / (1 - nu**2)

    def stress(strain: Any) -> Any:
        return young * ((1 - nu) * strain + nu * ng.Trace(strain) * ng.Id(2))

    plane = ng.VectorH1(mesh, order=order, dirichletx=held_x, dirichlety=held_y)
    u, v = plane.TnT()
    stiffness = ng.BilinearForm(
        ng.InnerProduct(stress(ng.Sym(ng.Grad(u))), ng.Sym(ng.Grad(v))) * ng.dx, symmetric=True
    ).Assemble()
    load = ng.LinearForm(-ng.Trace(ng.Grad(v)) * ng.dx).Assemble()
    moved = ng.GridFunction(plane)
    moved.vec.data = stiffness.mat.Inverse(plane.FreeDofs(), inverse="sparsecholesky") * load.vec
    return ng.Id(2) + stress(ng.Sym(ng.Grad(moved)))


def rigidity(model: Model) -> float:
    """D/(σ₀h) [µm²]."""
    film = model.film
    return film.young * film.thickness**2 / 12 / (1 - film.poisson**2) / film.stress * UNIT**2


def _geometry(model: Model) -> Any:
    """The quarter x > 0, y > 0."""
    shapes = import_module("netgen.geom2d")
    half = model.outline.length / 2 * UNIT
    radius = model.holes.radius * UNIT
    names = {"left": "mirror_x", "bottom": "mirror_y", "right": "edge", "top": "edge"}
    film = shapes.Rectangle(pmin=(0, 0), pmax=(half, half), **names)
    for x, y in model.holes.centres * UNIT:
        if min(x, y) > -radius:
            film = film - shapes.Circle(center=(x, y), radius=radius, bc="hole")
    geometry = shapes.CSG2d()
    geometry.Add(film)
    return geometry


def plate(space: Any, tension: Any, rigidity: float, nu: float, still: str) -> Any:
    """The inverse of tension and bending.

    Deflections come first among its unknowns, then moments and slopes, which are zero on `still`.
    """
    ng = import_module("ngsolve")
    moments = ng.Discontinuous(ng.HDivDiv(space.mesh, order=space.globalorder - 1))
    slopes = ng.NormalFacetFESpace(space.mesh, order=space.globalorder - 1, dirichlet=still)
    whole = space * moments * slopes
    (w, s, a), (z, t, b) = whole.TnT()
    normal = ng.specialcf.normal(2)
    form = ng.BilinearForm(whole, symmetric=True, condense=True)
    # −∫ σ:D⁻¹τ + Σ_T (∫ σ:∇∇z − ∫_∂T σ_nn (∂z/∂n − b_n)) + the same with w and τ.
    form += (
        -ng.InnerProduct((s - nu / (1 + nu) * ng.Trace(s) * ng.Id(2)) / (rigidity * (1 - nu)), t)
        * ng.dx
    )
    for moment, deflection, slope in ((s, z, b), (t, w, a)):
        form += ng.InnerProduct(moment, deflection.Operator("hesse")) * ng.dx
        form += (
            -(moment * normal)
            * normal
            * ((ng.grad(deflection) - slope) * normal)
            * ng.dx(element_boundary=True)
        )
    form += ng.InnerProduct(tension * ng.grad(w), ng.grad(z)) * ng.dx
    form.Assemble()
    schur = form.mat.Inverse(whole.FreeDofs(True), inverse="sparsecholesky")
    one = ng.IdentityMatrix(whole.ndof)
    return (one + form.harmonic_extension) @ schur @ (
        one + form.harmonic_extension_trans
    ) + form.inner_solve


def lowest(inverse: Any, mass: Any, free_dofs: Any, count: int) -> list[float]:
    """Return the least eigenvalues, as many as asked."""
    free = np.flatnonzero(np.array(list(free_dofs), dtype=bool))
    right = inverse.CreateColVector()
    left = inverse.CreateColVector()
    rows, columns, values = mass.COO()
    half = sp.coo_matrix((np.array(values), (np.array(rows), np.array(columns)))).tocsr()
    whole = half + half.T - sp.diags(half.diagonal()) if sp.triu(half, 1).nnz == 0 else half
    heavy = whole[free][:, free]

    def apply(x: Array) -> Array:
        right.FV().NumPy()[:] = 0
        right.FV().NumPy()[free] = x.ravel()
        left.data = inverse * right
        return np.array(left.FV().NumPy()[free])

    # With the inverse at hand eigsh asks nothing of the first matrix but its shape.
    inverse_k = LinearOperator(heavy.shape, matvec=apply, dtype=float)
    return list(
        eigsh(heavy, k=count, M=heavy, sigma=0.0, OPinv=inverse_k, return_eigenvectors=False)
    )
