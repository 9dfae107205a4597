"""The weak forms: symmetric, blind to rigid motions, exact on polynomials, stable."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import spsolve
from skfem import MeshTri1, MeshTri2

from femnl.core.device import Model
from femnl.device.mesh import mesh
from femnl.mechanics.fem import forms, interior_penalty
from femnl.mechanics.fem.elements import Space

Array = NDArray[np.float64]
RIGIDITY = 2.0
POISSON = 0.23


def grid(stretch: float = 1.0, refine: int = 2, seed: int = 5) -> MeshTri2:
    """The unit square in irregular straight triangles, stretched along x.

    Boundary `clamped` is its lower side.
    """
    linear = MeshTri1.init_sqsymmetric().refined(refine - 1)
    points = np.array(linear.p)
    inner = linear.interior_nodes()
    points[:, inner] += np.random.default_rng(seed).uniform(-0.2, 0.2, (2, len(inner))) / 2**refine
    moved = MeshTri2.from_mesh(MeshTri1(points * np.array([[stretch], [1.0]]), linear.t))
    named: MeshTri2 = moved.with_boundaries({"clamped": lambda x: np.isclose(x[1], 0)})
    return named


def layers() -> MeshTri2:
    """The unit square in rows whose heights differ a thousandfold from one to the next."""
    linear = MeshTri1.init_tensor(np.linspace(0, 1, 4), np.array([0.0, 1e-6, 1e-3, 1.0]))
    named: MeshTri2 = MeshTri2.from_mesh(linear).with_boundaries(
        {"clamped": lambda x: np.isclose(x[1], 0, atol=1e-9)}
    )
    return named


def uniform(point: Array) -> Array:
    return np.full(point.shape[:-1], RIGIDITY)


def moduli(poisson: float = POISSON) -> Array:
    """D(1−ν)∇∇w:∇∇v + DνΔwΔv as a matrix on (xx, yy, 2xy)."""
    return RIGIDITY * (1 - poisson**2) * forms.plane_stress(1.0, poisson)


def broken_energy(space: Space, poisson: float = POISSON) -> csc_matrix:
    """The bending energy triangle by triangle."""
    total = forms.Assembly(space.size)
    for cell in forms.cells(space, 2 * space.degree, second=True):
        total.add(
            forms.local_matrices(forms.curvature(cell.jet), moduli(poisson), cell.dx),
            space.dofs[cell.triangles],
        )
    return total.matrix()


def edge_terms(space: Space, facets: NDArray[np.int64], poisson: float = POISSON) -> csc_matrix:
    total = forms.Assembly(space.size)
    for local, dofs in interior_penalty.slope_continuity(
        space, facets, interior_penalty.isotropic(uniform, poisson), poisson
    ):
        total.add(local, dofs)
    return total.matrix()


def plate(space: Space, poisson: float = POISSON, held: bool = False) -> csc_matrix:
    """The interior penalty plate, free all around or with the slope held on `clamped`."""
    matrix = broken_energy(space, poisson) + edge_terms(
        space, np.flatnonzero(space.mesh.f2t[1] >= 0), poisson
    )
    return csc_matrix(
        matrix + edge_terms(space, space.boundary_facets("clamped"), poisson) if held else matrix
    )


@pytest.fixture(scope="module")
def curved(device: Callable[..., Model]) -> MeshTri2:
    """A perforated disc in a few curved triangles."""
    holes = 'lattice = "list"\ncentres = [["0.1 m", "0.2 m"]]\nradius = "0.3 m"'
    return mesh(device('kind = "circle"\ndiameter = "2 m"', holes), "full", 0.4).mesh


@pytest.mark.parametrize("degree", [2, 3, 4])
def test_the_plate_is_symmetric(curved: MeshTri2, degree: int) -> None:
    matrix = plate(Space(curved, degree), held=True)
    assert abs(matrix - matrix.T).max() < 1e-12 * abs(matrix).max()


@pytest.mark.parametrize("degree", [2, 3, 4])
def test_lifting_and_tilting_a_free_plate_cost_no_energy(curved: MeshTri2, degree: int) -> None:
    space = Space(curved, degree)
    x, y = space.location.T
    matrix = plate(space)
    for motion in (np.ones_like(x), x, y):
        assert np.abs(matrix @ motion).max() < 1e-11 * abs(matrix).max()


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_moving_and_turning_in_plane_cost_no_energy(curved: MeshTri2, degree: int) -> None:
    space = Space(curved, degree)
    x, y = space.location.T
    total = forms.Assembly(2 * space.size)
    for cell in forms.cells(space, 2 * degree):
        stiffness = forms.local_matrices(
            forms.in_plane_strain(cell.jet), forms.plane_stress(1.0, 0.3), cell.dx
        )
        total.add(stiffness, forms.vector_dofs(space, cell.triangles))
    matrix = total.matrix()
    still = np.zeros_like(x)
    motions = [(still + 1, still), (still, still + 1)]
    if degree > 1:  # on curved triangles x and y themselves are quadratic
        motions.append((-y, x))
    for motion in motions:
        assert np.abs(matrix @ np.concatenate(motion)).max() < 1e-12 * abs(matrix).max()
    assert np.concatenate([x, still]) @ matrix @ np.concatenate([x, still]) > 0.1


@pytest.mark.parametrize(("degree", "cubic"), [(2, 0.0), (3, 1.0), (4, 1.0)])
def test_the_plate_reproduces_a_polynomial_deflection_and_its_moment_exactly(
    degree: int, cubic: float
) -> None:
    # w = y²(1 + cubic·(x + y)) bends without load in the inside and is clamped at y = 0.
    square = grid(refine=3)
    space = Space(square, degree)

    def exact(point: Array) -> Array:
        x = point[..., 0]
        y = point[..., 1]
        return np.asarray(y**2 * (1 + cubic * (x + y)))

    def curvature(point: Array) -> Array:
        x = point[..., 0]
        y = point[..., 1]
        return np.stack([0 * x, 2 + cubic * (2 * x + 6 * y), 2 * cubic * y], -1)

    # Deflection and slope are given on the other three sides, through all unknowns of the triangles
    # there.
    other = np.setdiff1d(
        square.boundary_facets(), square.boundaries["clamped"] if square.boundaries else []
    )
    known = np.union1d(
        space.dofs[np.unique(square.f2t[0, other])].ravel(), space.boundary_dofs("clamped")
    )
    free = np.setdiff1d(np.arange(space.size), known)
    assert len(free) > 20
    matrix = plate(space, held=True)
    w = exact(space.location)
    w[free] = spsolve(matrix[free][:, free], -matrix[free][:, known] @ w[known])
    np.testing.assert_allclose(w, exact(space.location), atol=1e-11)
    jet = space.jet(slice(None), np.array([[0.2, 0.3]]), second=True)
    np.testing.assert_allclose(
        np.einsum("eqcj,ej->eqc", jet.hessian, w[space.dofs]), curvature(jet.point), atol=1e-8
    )


@pytest.mark.parametrize("degree", [2, 3, 4])
@pytest.mark.parametrize("poisson", [-0.5, 0.0, 0.23, 0.49])
@pytest.mark.parametrize(
    "shape", [grid(), grid(100), layers()], ids=["regular", "stretched", "layers"]
)
def test_the_plate_stays_coercive_on_stretched_triangles(
    degree: int, poisson: float, shape: MeshTri2
) -> None:
    space = Space(shape, degree)
    slopes = np.concatenate([np.flatnonzero(shape.f2t[1] >= 0), space.boundary_facets("clamped")])
    energy = broken_energy(space, poisson).toarray()
    total = energy + edge_terms(space, slopes, poisson).toarray()
    free = np.setdiff1d(np.arange(space.size), space.boundary_dofs("clamped"))
    # No deflection has less than a fixed part of its bending energy: at worst 0.65, with two thirds
    # of the penalty 0.48.
    size = np.sqrt(np.diag(total)[free])
    energy, total = (
        matrix[np.ix_(free, free)] / size / size[:, None] for matrix in (energy, total)
    )
    assert 1 / eigh(energy, total)[0][-1] > 0.6


def test_in_plane_strain_of_a_linear_displacement_is_the_symmetric_part_of_its_gradient() -> None:
    space = Space(grid(), 2)
    gradient = np.random.default_rng(7).standard_normal((2, 2))  # ∂u_a/∂x_b
    u = (space.location @ gradient.T).T.ravel()
    expected = [gradient[0, 0], gradient[1, 1], gradient[0, 1] + gradient[1, 0]]
    for cell in forms.cells(space, 2):
        strain = np.einsum(
            "eqcj,ej->eqc",
            forms.in_plane_strain(cell.jet),
            u[forms.vector_dofs(space, cell.triangles)],
        )
        np.testing.assert_allclose(strain, np.broadcast_to(expected, strain.shape), atol=1e-12)


@pytest.mark.parametrize("poisson", [0.0, 0.23, 0.4])
def test_plane_stress_inverts_hookes_law(poisson: float) -> None:
    compliance = np.array([[1, -poisson, 0], [-poisson, 1, 0], [0, 0, 2 * (1 + poisson)]]) / 3.0
    np.testing.assert_allclose(forms.plane_stress(3.0, poisson) @ compliance, np.eye(3), atol=1e-14)


def test_stretch_is_half_the_symmetrised_product_of_slopes() -> None:
    a, b = np.random.default_rng(6).standard_normal((2, 5, 2))
    tensor = (a[:, :, None] * b[:, None, :] + b[:, :, None] * a[:, None, :]) / 4
    expected = np.stack([tensor[:, 0, 0], tensor[:, 1, 1], 2 * tensor[:, 0, 1]], -1)
    np.testing.assert_allclose(forms.stretch(a, b), expected, atol=1e-15)


def test_the_film_is_thinned_towards_the_holes_as_its_taper_says(
    device: Callable[..., Model],
) -> None:
    film = [
        'thickness = "1 um"',
        'taper = "0.4 um"',
        'taper_length = "2 um"',
        'young = "250 GPa"',
        'stress = "1 GPa"',
    ]
    holes = [
        'lattice = "list"',
        'centres = [["0 um", "0 um"], ["9 um", "0 um"]]',
        'radius = "1 um"',
    ]
    rest = ["poisson = 0.2", 'density = "3000 kg/m^3"']
    model = device('kind = "square"\nside = "40 um"', "\n".join(holes), "\n".join(film + rest))
    where = np.array([[0, 1.0], [0, 2.0], [0, 3.0], [8.0, 0], [-15.0, 0]]) * 1e-6
    np.testing.assert_allclose(
        forms.thickness(model, where), np.array([0.6, 0.8, 1.0, 0.6, 1.0]) * 1e-6, rtol=1e-12
    )


def test_meshes_of_more_triangles_than_a_chunk_are_walked_over_completely() -> None:
    square = grid(refine=6)
    pieces = list(forms.cells(Space(square, 2), 4))
    assert square.nelements > 4 * forms.CHUNK
    assert [cell.triangles.start for cell in pieces[1:]] == [
        cell.triangles.stop for cell in pieces[:-1]
    ]
    (x0, y0), (x1, y1), (x2, y2) = square.p[:, square.t[:3]].transpose(1, 0, 2)
    area = np.abs((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)) / 2
    np.testing.assert_allclose(
        np.concatenate([cell.dx.sum(axis=1) for cell in pieces]), area, rtol=1e-12
    )


def test_entries_summed_on_the_way_make_the_same_matrix() -> None:
    rng = np.random.default_rng(1)
    locals_ = rng.standard_normal((5, 7, 3, 3))
    dofs = rng.integers(0, 9, (5, 7, 3))
    expected = np.zeros((9, 9))
    for local, at in zip(locals_.reshape(-1, 3, 3), dofs.reshape(-1, 3), strict=True):
        np.add.at(expected, (at[:, None], at[None, :]), local)
    total = forms.Assembly(9, held=100)
    for local, at in zip(locals_, dofs, strict=True):
        total.add(local, at)
    assert total.matrix().toarray() == pytest.approx(expected, abs=1e-12)
