"""The perforated membrane as one writes it with scikit-fem, scipy and gmsh from their examples."""

from typing import Any

import gmsh
import numpy as np
from scipy.sparse.linalg import eigsh, spsolve
from skfem import Basis, BilinearForm, ElementTriP2, ElementVector, LinearForm, MeshTri
from skfem.helpers import ddot, dot, eye, grad, sym_grad, trace

from femnl.core.device import Model


def plain_scikit_fem(model: Model, count: int) -> list[float]:
    """Return the ratios f/f₁ as a plain finite-element script would.

    Boolean cut of all holes, quadratic elements on straight triangles, spsolve in plane, eigsh
    out of it.
    """
    film = model.film
    half = model.outline.length / 2
    unit = 1e6
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    occ = gmsh.model.occ
    square = occ.addRectangle(-half * unit, -half * unit, 0, 2 * half * unit, 2 * half * unit)
    radius = model.holes.radius * unit
    occ.cut(
        [(2, square)],
        [(2, occ.addDisk(x * unit, y * unit, 0, radius, radius)) for x, y in model.holes.centres],
    )
    occ.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 12)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 1.7)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    gmsh.model.mesh.generate(2)
    tags, points, _ = gmsh.model.mesh.getNodes()
    triangles = gmsh.model.mesh.getElementsByType(2)[1].reshape(-1, 3)
    gmsh.finalize()
    row = np.empty(int(tags.max()) + 1, dtype=int)
    row[tags] = np.arange(len(tags))
    used, numbered = np.unique(row[triangles], return_inverse=True)
    mesh = MeshTri(points.reshape(-1, 3)[used, :2].T / unit, numbered.reshape(-1, 3).T)
    mesh = mesh.with_boundaries({"edge": lambda x: np.max(np.abs(x), axis=0) > half * (1 - 1e-6)})

    young = film.young / (1 - film.poisson**2)
    poisson = film.poisson
    plane, flexure = (
        Basis(mesh, element, intorder=4)
        for element in (ElementVector(ElementTriP2()), ElementTriP2())
    )

    def stress(strain: Any) -> Any:
        return young * ((1 - poisson) * strain + poisson * eye(trace(strain), 2))

    @BilinearForm
    def stiffness(u: Any, v: Any, _: Any) -> Any:
        return ddot(stress(sym_grad(u)), sym_grad(v))

    @LinearForm
    def load(v: Any, _: Any) -> Any:
        return -film.stress * trace(grad(v))

    matrix = stiffness.assemble(plane)
    right = load.assemble(plane)
    free = np.setdiff1d(np.arange(plane.N), plane.get_dofs("edge").flatten())
    displacement = np.zeros(plane.N)
    displacement[free] = spsolve(matrix[free][:, free].tocsc(), right[free])
    moved: Any = plane.interpolate(displacement)
    strained = sym_grad(moved)

    @BilinearForm
    def tension(u: Any, v: Any, _: Any) -> Any:
        return film.stress * dot(grad(u), grad(v)) + np.einsum(
            "ij...,i...,j...->...", stress(strained), grad(u), grad(v)
        )

    @BilinearForm
    def mass(u: Any, v: Any, _: Any) -> Any:
        return film.density * u * v

    free = np.setdiff1d(np.arange(flexure.N), flexure.get_dofs("edge").flatten())
    k, m = (form.assemble(flexure)[free][:, free].tocsc() for form in (tension, mass))
    squares = eigsh(k, k=count, M=m, sigma=0.0, return_eigenvectors=False)
    return [float(r) for r in np.sqrt(np.sort(squares) / np.min(squares))]
