"""The film stress after release, relaxed until holes and free edges carry no traction."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from femnl.core.arrays import freeze
from femnl.core.device import Clamp, Edge, Model
from femnl.core.domain import Domain, Prestress
from femnl.core.errors import ParameterError
from femnl.core.operators import DIRECTIONS, POWERS, WEIGHTS, Units, weights
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import (
    Assembly,
    cells,
    in_plane_strain,
    local_matrices,
    local_vectors,
    quadrature_order,
    vector_dofs,
)
from femnl.mechanics.fem.sheet import Sheet
from femnl.mechanics.fem.solvers import factorize
from femnl.mechanics.fem.supports import in_plane_draw, in_plane_springs, in_plane_supports

Array = NDArray[np.float64]

ROUNDING = 1e-13
"""Of the largest eigenvalue of a small matrix, what may be rounding."""

MIRRORED = tuple(
    (b % 2 == shear, a % 2 == shear)
    for a, b in POWERS
    for shear in (direction == "xy" for direction in DIRECTIONS)
)
"""Whether each weight times each direction is even under y → −y, and under x → −x."""


def solve_prestress(domain: Domain, degree: int, edge: Edge = "clamped") -> Prestress:
    """Relax the film stress: solve for the in-plane displacement u at which it is in equilibrium.

    ∫ h (σ₀ I + C ε(u)) : ε(v) + ∮ k (u − u₀)·v ds = 0 for all v, with u held where the edge is
    rigid.

    Springs of an elastic edge are at rest at u₀ = 0, the edge of the film as deposited, or `draw`
    inwards of it: the film's whole pull displaces them.

    Args: domain: the meshed film. degree: polynomial degree of u, 1 to 4. edge: `clamped` u = 0 on
        the clamped part of the outline, or `sliding` u·n = 0 and no shear there, as on the mirror
        lines between the cells of a lattice.
    Returns: u [m] at the unknowns of (u_x, u_y); zero where an even film is clamped all around.
    Raises: ConvergenceError where the film is not supported.
    Source: plane stress with the film stress as initial stress; checked by
    `validation/unit_cell.py`.
    """
    space = Space(domain.mesh, degree)
    sheet = Sheet(domain)
    clamp = domain.model.clamp
    stiffness, loads = _in_plane(
        domain, space, sheet, lambda triangles, point: sheet.tension(triangles, point)[None]
    )
    matrix = stiffness.matrix() + in_plane_springs(space, clamp)
    load = in_plane_draw(space, clamp) + loads[0]
    supports = in_plane_supports(space, domain.wedge, edge, (True, True), clamp)
    return Prestress(
        domain,
        degree,
        supports @ factorize(csc_matrix(supports.T @ matrix @ supports))(supports.T @ load),
    )


@dataclass(frozen=True)
class YieldingEdges:
    """Films whose edge yields in its plane by some compliances, and what lies between them.

    displacement (m, n_dofs) [m]: of each; stiffness (m, m) and load (m,) [J]: ∫ h C ε(uᵢ) : ε(uⱼ)
    and the work of the film stress on each, without what the edge does.
    """

    domain: Domain
    degree: int
    displacement: Array
    stiffness: Array
    load: Array

    def __post_init__(self) -> None:
        freeze(self)

    def shares(self, compliance: float) -> Array:
        """Return shares (m,) of the solved displacements in that of another compliance [m].

        Galerkin's method in the span of the solved ones finds them: no other displacement of the
        span has less energy.
        """
        space = Space(self.domain.mesh, self.degree)
        clamp = yielding_clamp(self.domain.model, compliance)
        springs = self.displacement @ (in_plane_springs(space, clamp) @ self.displacement.T)
        load = self.load + self.displacement @ in_plane_draw(space, clamp)
        energy = self.stiffness + springs
        # Neighbours are nearly parallel, and directions below rounding are left out
        scale = np.sqrt(np.diag(energy))
        values, vectors = np.linalg.eigh(energy / np.outer(scale, scale))
        kept = values > ROUNDING * values[-1]
        turned = vectors[:, kept]
        return np.asarray(turned @ ((turned.T @ (load / scale)) / values[kept]) / scale)


def yielding_clamp(model: Model, compliance: float) -> Clamp:
    """Return the clamp with springs kₙ = Eh/λ across and kₛ = kₙ (1 − ν)/2 along the edge.

    Those of a strip of that film, λ/(1 − ν²) wide, in series with what the geometry says of the
    edge. Args: compliance: λ [m], above 0.
    """
    film = model.film
    clamp = model.clamp
    across = film.young * film.thickness / compliance
    along = across * (1 - film.poisson) / 2
    return replace(
        clamp,
        normal=1 / (1 / clamp.normal + 1 / across),
        shear=1 / (1 / clamp.shear + 1 / along),
    )


def solve_yielding(domain: Domain, degree: int, compliances: Sequence[float]) -> YieldingEdges:
    """Relax the film stress where a ledge between film and frame yields in its plane.

    Args: domain, degree: as for `solve_prestress`. compliances: λ [m] of `yielding_clamp`.
    """
    space = Space(domain.mesh, degree)
    sheet = Sheet(domain)
    assembly, loads = _in_plane(
        domain, space, sheet, lambda triangles, point: sheet.tension(triangles, point)[None]
    )
    stiffness = assembly.matrix()
    # Springs alone hold the edge, whatever their stiffness
    yields = yielding_clamp(domain.model, compliances[0])
    supports = in_plane_supports(space, domain.wedge, "clamped", (True, True), yields)
    found = []
    for compliance in compliances:
        clamp = yielding_clamp(domain.model, compliance)
        matrix = supports.T @ (stiffness + in_plane_springs(space, clamp)) @ supports
        load = supports.T @ (loads[0] + in_plane_draw(space, clamp))
        found.append(supports @ factorize(csc_matrix(matrix))(load))
    displacement = np.array(found)
    return YieldingEdges(
        domain,
        degree,
        displacement,
        displacement @ (stiffness @ displacement.T),
        displacement @ loads[0],
    )


def solve_units(domain: Domain, degree: int) -> Units:
    """Relax a film stress of each of `WEIGHTS` times each of `DIRECTIONS`.

    Find u with ∫ h (φ s + C ε(u)) : ε(v) + ∮ k u·v ds = 0 for all v.

    Args: as for `solve_prestress`. Returns: u of each, of which those of xx and of yy together
        relax an isotropic stress. Where an even film is clamped all around, those of φ = 1 vanish.
    Raises: ParameterError for a wedge between mirrors at an angle, on which these stresses are
    neither even nor odd; ConvergenceError.
    """
    if domain.wedge < np.pi / 2 - 1e-9:
        raise ParameterError(
            f"{domain.model.name}: a wedge of {np.degrees(domain.wedge):g}° holds even stresses "
            "alone; mesh a quarter or more"
        )
    space = Space(domain.mesh, degree)
    sheet = Sheet(domain)
    clamp = domain.model.clamp
    reach = float(np.abs(domain.mesh.p).max())
    components = np.eye(len(DIRECTIONS))

    def stresses(triangles: slice, point: Array) -> Array:
        values = weights(np.moveaxis(point, -1, 0) / reach)
        h = sheet.thickness(triangles, point)
        return (values[:, None, :, :, None] * h[..., None] * components[:, None, None]).reshape(
            -1, *point.shape[:2], len(DIRECTIONS)
        )

    stiffness, loads = _in_plane(domain, space, sheet, stresses)
    matrix = stiffness.matrix() + in_plane_springs(space, clamp)
    found = np.zeros_like(loads)
    mirrors = {4: 2, 2: 1, 1: 0}[domain.copies]
    parities = [even[:mirrors] for even in MIRRORED]
    for even in sorted(set(parities)):
        members = [k for k, parity in enumerate(parities) if parity == even]
        supports = in_plane_supports(space, domain.wedge, "clamped", even, clamp)
        found[members] = (
            supports
            @ factorize(csc_matrix(supports.T @ matrix @ supports))(supports.T @ loads[members].T)
        ).T
    return Units(degree, reach, found.reshape(len(WEIGHTS), len(DIRECTIONS), -1))


def _in_plane(
    domain: Domain, space: Space, sheet: Sheet, tensions: Callable[[slice, Array], Array]
) -> tuple[Assembly, Array]:
    """Return the stiffness ∫ A ε(u) : ε(v), and loads −∫ N : ε(v) (n, 2·size).

    tensions: N (n, e, q, 3) [N/m] of triangles at points (e, q, 2) [m].
    """
    assembly = Assembly(2 * space.size)
    loads = None
    for cell in cells(space, quadrature_order(domain.model, 2 * space.degree)):
        strain = in_plane_strain(cell.jet)
        dofs = vector_dofs(space, cell.triangles)
        given = tensions(cell.triangles, cell.jet.point)
        loads = np.zeros((len(given), 2 * space.size)) if loads is None else loads
        for load, tension in zip(loads, given, strict=True):
            np.add.at(load, dofs, -local_vectors(strain, tension, cell.dx))
        assembly.add(
            local_matrices(strain, sheet.membrane(cell.triangles, cell.jet.point), cell.dx), dofs
        )
    return assembly, np.asarray(loads)
