"""Second-order stretching of a tiled film.

Tiles of one kind share the few strains that smooth shapes make in them.
"""

import numpy as np
from numpy.typing import NDArray

from femnl.core.device import Edge
from femnl.core.errors import ConvergenceError
from femnl.core.modes import Modes
from femnl.mechanics.fem.forms import slope, stretch
from femnl.mechanics.lattice.relaxed import Frame, InPlane
from femnl.mechanics.lattice.sides import Sides
from femnl.mechanics.lattice.tile import Membrane
from femnl.mechanics.lattice.tiling import tile
from femnl.mechanics.nonlinearity import Pairs

Array = NDArray[np.float64]

LEFT = 1e-8  # of the largest shape in a kind of tile, what is left out of the others
ROUNDING = 1e-15  # of the largest energy, below which others are rounding
SKETCH = 96  # shapes that a tile is first expected to see at most
CHUNK = 20_000  # pairs and tiles at a time


def strain_energies(modes: Modes, pairs: Pairs, edge: Edge) -> Array:
    """Return G over the whole film for all combinations of pairs, (n_pairs, n_pairs) [N/m³].

    See `femnl.mechanics.nonlinearity`.

    In each kind of tile the modes are Σ d_a ψ_a with few ψ. The strains of all ψ_a, ψ_b, and what
    they relax to while the sides of the tile are held, are computed once; the sides of all tiles
    then relax together.

    Args: modes: of a tiled film. Raises: ConvergenceError where the modes are on another mesh.
    """
    model = modes.domain.model
    frame = Frame(tile(model, modes.domain.tiles), modes.degree)
    if not np.array_equal(frame.tiling.domain.mesh.t, modes.domain.mesh.t):
        raise ConvergenceError(
            f"{model.name}: these modes were solved with the mesh of another mesher; solve them "
            "anew with --no-cache"
        )
    model = frame.tiling.model
    poisson = 0.0 if edge == "paper" else model.film.poisson
    # The same points for all integrals: where h varies, G stays the energy of one discrete film.
    membranes = [Membrane(sides, model, poisson, 4 * frame.degree - 4) for sides in frame.sides]
    energies = np.zeros((len(pairs), len(pairs)))
    loads = []
    for k, membrane in enumerate(membranes):
        shared, amounts = _common(modes.shapes[:, frame.numbering.dofs[k]])
        energy, load = _of_kind(frame.sides[k], membrane, shared)
        tiles = amounts.shape[1]
        at_edge = np.empty((len(pairs), tiles, load.shape[1]))
        step = max(CHUNK // len(pairs), 1)
        for start in range(0, tiles, step):
            some = slice(start, start + step)
            products = _products(amounts[:, some], pairs)
            stored = (products @ energy).reshape(len(pairs), -1)
            energies += stored @ stored.T
            at_edge[:, some] = products @ load
        loads.append(at_edge)
    in_plane = InPlane(frame.skeleton, membranes)
    right = in_plane.gather(loads)
    parities = [
        tuple(a * b for a, b in zip(modes.parity[i], modes.parity[j], strict=True))
        for i, j in pairs
    ]
    for parity in set(parities):
        members = [n for n, p in enumerate(parities) if p == parity]
        moved = in_plane.solve(right[:, members], frame.skeleton.free_in_plane(edge, parity))
        energies[np.ix_(members, members)] -= right[:, members].T @ moved
    alike = np.array([[p == q for q in parities] for p in parities])
    return np.where(alike, energies, 0.0) * modes.domain.copies


def _common(shapes: Array) -> tuple[Array, Array]:
    """Return few functions ψ (size, r) that span shapes (n, tiles, size), less a constant each.

    Their amounts (n, tiles, r).
    """
    n, tiles, size = shapes.shape
    flat = (shapes - shapes[..., :1]).reshape(-1, size).T
    random = np.random.default_rng(0)
    sketch = SKETCH
    while True:
        if sketch >= min(flat.shape):
            frame = np.linalg.qr(flat)[0] if flat.shape[1] < size else np.eye(size)
        else:
            frame = np.linalg.qr(flat @ random.standard_normal((flat.shape[1], sketch)))[0]
        left, singular, right = np.linalg.svd(frame.T @ flat, full_matrices=False)
        kept = singular > LEFT * singular[0]
        if not kept[-1] or sketch >= min(flat.shape):
            return frame @ (left[:, kept] * singular[kept]), right[kept].T.reshape(n, tiles, -1)
        sketch *= 2


def _of_kind(sides: Sides, membrane: Membrane, shared: Array) -> tuple[Array, Array]:
    """Return a root of the energies of the strains of all ψ_a, ψ_b, and their loads.

    The energies (r², rank) are those at held sides; the loads (r², n) act on the sides.
    """
    slopes = np.einsum(
        "eqxj,ejn->neqx", slope(membrane.cell.jet), shared[sides.space.dofs], optimize=True
    )
    r = shared.shape[1]
    first, second = np.triu_indices(r)
    strain = stretch(slopes[first], slopes[second])
    stress = (strain[..., None, :] @ membrane.modulus)[..., 0, :]
    load = membrane.load(stress)
    still, at_edge = membrane.respond(load)
    weighted = (stress * membrane.cell.dx[..., None]).reshape(len(first), -1)
    values, vectors = np.linalg.eigh(strain.reshape(len(first), -1) @ weighted.T - load.T @ still)
    kept = values > ROUNDING * values[-1]
    both = np.empty((r, r), dtype=np.int64)
    both[first, second] = both[second, first] = np.arange(len(first))
    return (vectors[:, kept] * np.sqrt(values[kept]))[both.ravel()], at_edge.T[both.ravel()]


def _products(amounts: Array, pairs: Pairs) -> Array:
    """Return the amounts (pairs, tiles, r²) of the strains of all ψ_a, ψ_b in pairs of modes.

    They are products of the amounts (n, tiles, r) of ψ in the modes.
    """
    i, j = np.array(pairs).T
    return np.asarray(
        (amounts[i][:, :, :, None] * amounts[j][:, :, None, :]).reshape(
            len(pairs), amounts.shape[1], -1
        )
    )
