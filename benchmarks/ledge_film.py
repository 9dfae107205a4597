"""A square film as a sheet whose edge moves in its plane, and what that does to f22/f11.

The film is an even sheet in each of three zones: the array of holes, the margin without holes, and
the film on the ledge around. Its change of stress δN changes a mode's λ to first order by

    δλ/λ = ∫ δN : ∇ξ⊗∇ξ / ∫ N |∇ξ|²   with the sines ξ of the even film.

Limits: small changes of a film without bending and holes, which `tests/physics/test_ledge.py` holds
to 3 %. Bending, margin and taper halve the answer of J10: see `benchmarks.ledge_modes`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix
from skfem import (
    Basis,
    BilinearForm,
    ElementQuad0,
    ElementQuadS2,
    ElementVector,
    Functional,
    LinearForm,
    Mesh,
    MeshQuad,
)
from skfem.assembly.form.form import FormExtraParams
from skfem.element import DiscreteField
from skfem.helpers import sym_grad, trace

from benchmarks.ledge_section import graded
from femnl.core.device import Film, Model
from femnl.mechanics.fem.solvers import factorize
from femnl.mechanics.lattice import solve_cell

Array = NDArray[np.float64]
Motion = Callable[[Array], tuple[Array, Array]]

ARRAY, MARGIN, LEDGE = range(3)


@dataclass(frozen=True)
class Sheet:
    """The film as a sheet: array of holes, margin, film on the ledge, in this order.

    stiffness: (c11, c12, c66) [N/m] of each; tension [N/m] of each at zero strain; margin, its
    width [m]; side of the square [m]; corner [m]: a square of ledge that stays in each corner.
    """

    stiffness: tuple[tuple[float, float, float], ...]
    tension: tuple[float, float, float]
    margin: float
    side: float
    corner: float = 0.0

    @property
    def half(self) -> float:
        """Half a side [m]."""
        return self.side / 2

    def on_ledge(self, x: Array, y: Array) -> NDArray[np.bool_]:
        """Whether places [m] of the first quarter lie on the ledge."""
        near = np.minimum(x, y) > self.half - self.corner
        return np.asarray((np.maximum(x, y) > self.half) | near)

    def zones(self, mesh: Mesh) -> NDArray[np.int64]:
        """Zone of each element."""
        x, y = mesh.p[:, mesh.t].mean(axis=1)
        within = np.maximum(x, y) < self.half - self.margin
        return np.where(self.on_ledge(x, y), LEDGE, np.where(within, ARRAY, MARGIN))

    def lines(self, finest: float, growth: float, beyond: float = 0.0) -> Array:
        """Lines of a mesh from the centre to `beyond` the edge [m], finest [m] at the edge."""
        inner = self.half - graded(self.half, finest, growth)
        outer = self.half + graded(beyond, finest, growth) if beyond else np.array([self.half])
        marks = [self.half - self.margin, self.half - self.corner]
        apart = np.min(np.abs(np.subtract.outer(inner, marks)), axis=1) > finest / 4
        return np.unique(np.round(np.concatenate([inner[apart | (inner == 0)], outer, marks]), 12))


def sheet_of(device: Model, film: Film, pitch: float, side: float, corner: float = 0.0) -> Sheet:
    """Return the sheet of a film with the device's holes; see `Sheet`."""
    cell = solve_cell(replace(device, film=film), pitch)
    rigidity = film.young * film.thickness / (1 - film.poisson**2)
    bare = (rigidity, rigidity * film.poisson, rigidity * (1 - film.poisson) / 2)
    count = round(np.sqrt(len(device.holes.centres)))
    tension = film.stress * film.thickness
    return Sheet(
        ((cell.c11, cell.c12, cell.c66), bare, bare),
        (cell.tension, tension, tension),
        (side - count * pitch) / 2,
        side,
        corner,
    )


def film_basis(lines: Array) -> Basis:
    """Return the sheet's elements on a grid; serendipity, as on the faces of the solid's."""
    mesh = MeshQuad.init_tensor(lines, lines)
    return Basis(mesh, ElementVector(ElementQuadS2()), intorder=4)


def film_system(flat: Basis, sheet: Sheet) -> tuple[csc_matrix, Array]:
    """Stiffness, and the loads (3, N) of a unit of tension on the ledge, in margin and array."""

    @BilinearForm
    def stiffness(u: DiscreteField, v: DiscreteField, w: FormExtraParams) -> Array:
        xx, yy, xy = _stress(w, u)
        strain = sym_grad(v)
        return np.asarray(xx * strain[0, 0] + yy * strain[1, 1] + 2 * xy * strain[0, 1])

    tension = LinearForm(lambda v, w: -w.within * trace(sym_grad(v)))
    constant = flat.with_element(ElementQuad0())
    zones = sheet.zones(flat.mesh)
    loads = [
        tension.assemble(flat, within=constant.interpolate((zones == zone).astype(float)))
        for zone in (LEDGE, MARGIN, ARRAY)
    ]
    return stiffness.assemble(flat, **_fields(flat, sheet)), np.array(loads)


def mode_stress(flat: Basis, sheet: Sheet, moved: Array) -> Array:
    """∫ δN : ∇ξ⊗∇ξ / ∫ |∇ξ|² [N/m] of (1,1) and (2,2)."""
    free = (sheet.zones(flat.mesh) != LEDGE).astype(float)
    suspended = flat.with_element(ElementQuad0()).interpolate(free)
    found = []
    for number in (1, 2):
        k = np.pi * number / sheet.side

        @Functional
        def work(w: FormExtraParams, k: float = k) -> Array:
            x = k * (w.x[0] + sheet.half)
            y = k * (w.x[1] + sheet.half)
            along_x = k * np.cos(x) * np.sin(y)
            along_y = k * np.sin(x) * np.cos(y)
            xx, yy, xy = _stress(w, w.u)
            pulled = xx * along_x**2 + 2 * xy * along_x * along_y + yy * along_y**2
            return np.asarray(w.free * pulled)

        fields = _fields(flat, sheet)
        whole = work.assemble(flat, u=flat.interpolate(moved), free=suspended, **fields)
        found.append(float(whole) / (k**2 * sheet.half**2 / 2))
    return np.array(found)


def held_film(sheet: Sheet, finest: float, motion: Motion | None = None) -> Array:
    """`mode_stress` (3, 2) of the tensions in a rigid edge, or (1, 2) of a motion of the edge.

    Args: motion, from places along a side, from its middle [m], to displacements inwards and along
    the edge towards its middle [m], without `corner`; finest, elements at the edge [m].
    """
    flat = film_basis(sheet.lines(finest, 1.3))
    matrix, loads = film_system(flat, sheet)
    x, y = flat.doflocs
    way = directions(flat)
    cut = sheet.half * (1 - 1e-9)
    held = (flat.doflocs[way, np.arange(flat.N)] < 1e-12) | (np.maximum(x, y) > cut)
    held |= np.minimum(x, y) > cut - sheet.corner
    moved = np.zeros((3 if motion is None else 1, flat.N))
    if motion is not None:
        loads = np.zeros((1, flat.N))
        for own, side, place in ((0, x > cut, y), (1, y > cut, x)):
            inwards, along = motion(place)
            moved[0] -= np.where(side, np.where(way == own, inwards, along), 0.0)
        moved[0, (x > cut) & (y > cut)] /= 2
    free = np.flatnonzero(~held)
    right = np.ascontiguousarray((loads - (matrix @ moved.T).T)[:, free].T)
    moved[:, free] = factorize(csc_matrix(matrix[free][:, free]))(right).T
    return np.array([mode_stress(flat, sheet, one) for one in moved])


def directions(basis: Basis) -> NDArray[np.int64]:
    """Axis of each degree of freedom."""
    found = np.zeros(basis.N, dtype=np.int64)
    for axis, indices in enumerate(basis.split_indices()):
        found[indices] = axis
    return found


def _stress(w: FormExtraParams, u: DiscreteField) -> tuple[Array, Array, Array]:
    strain = sym_grad(u)
    return (
        w.c11 * strain[0, 0] + w.c12 * strain[1, 1],
        w.c12 * strain[0, 0] + w.c11 * strain[1, 1],
        2 * w.c66 * strain[0, 1],
    )


def _fields(flat: Basis, sheet: Sheet) -> dict[str, Any]:
    constant = flat.with_element(ElementQuad0())
    values = np.array(sheet.stiffness)[sheet.zones(flat.mesh)]
    names = ("c11", "c12", "c66")
    return {name: constant.interpolate(values[:, i]) for i, name in enumerate(names)}
