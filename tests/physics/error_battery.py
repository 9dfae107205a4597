"""Fifty films with references, against which error bars are held.

Closed forms, published digits, and high degrees on finer meshes.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import jn_zeros

from femnl.core.device import Edge, Model
from femnl.core.modes import Modes
from femnl.core.nonlinearity import Nonlinearity
from femnl.core.outline import Holes
from femnl.device import geometry
from femnl.device.mesh import mesh
from femnl.mechanics.modes import solve_modes
from femnl.mechanics.nonlinearity import solve_nonlinearity
from femnl.mechanics.prestress import solve_prestress
from femnl.pipeline import solve_modes as solve_with_errors

Array = NDArray[np.float64]

COUNT = 6
QUANTITIES = ("f", "ratio", "m_eff", "k3", "alpha", "cross")
OUTLINES = {
    "square": 'kind = "square"\nside = "1 m"',
    "rectangle": 'kind = "rectangle"\nwidth = "1.4 m"\nheight = "1 m"',
    "circle": 'kind = "circle"\ndiameter = "2 m"',
    "hexagon": 'kind = "regular-polygon"\nsides = 6\nlong_axis = "2 m"',
    "octagon": 'kind = "regular-polygon"\nsides = 8\nlong_axis = "2 m"',
    "triangle": 'kind = "polygon"\npoints = [["0 m", "0 m"], ["1 m", "0 m"], ["0 m", "1 m"]]',
    "quadrangle": 'kind = "polygon"\npoints = [["-0.5 m", "-0.4 m"], ["0.6 m", "-0.45 m"], '
    '["0.5 m", "0.5 m"], '
    '["-0.4 m", '
    '"0.4 m"]]',
    "L": 'kind = "polygon"\npoints = [["0 m", "0 m"], ["2 m", "0 m"], ["2 m", "1 m"], ["1 m", '
    '"1 m"], ["1 m", "2 '
    'm"], ["0 '
    'm", "2 m"]]',
}
FILM = (
    'thickness = "1 um"\nyoung = "250 GPa"\npoisson = 0.23\ndensity = "1 kg/m^3"\nstress = "1 Pa"'
)


@dataclass(frozen=True)
class Film:
    """One film of a battery.

    exact: numbers known otherwise, by quantity, for the lowest modes. reference_degree, finer: of
    the references that are computed, by another degree on a mesh so many times as fine.
    """

    name: str
    model: Model
    resolution: float = 1.0
    edge: Edge = "clamped"
    exact: dict[str, Array] = field(default_factory=dict)
    symmetry: str = "auto"
    count: int = COUNT
    reference_degree: int = 6
    finer: float = 1.4


def outline(kind: str) -> Model:
    """A film without bending whose wave speed is 1 m/s."""
    text = (
        f'name = "{kind}"\nsource = "a '
        f'test"\n[outline]\n{OUTLINES[kind]}\n[film]\n{FILM}\n[model]\nbending = false'
    )
    return geometry.parse(text)


def stiff(model: Model, layer: float, tension: float = 1.0) -> Model:
    """Return the film with a bending length √(D/σh) of `layer` [m], under another stress."""
    film = model.film
    young = 12 * (1 - film.poisson**2) * (layer / film.thickness) ** 2
    return replace(model, bending=True, film=replace(film, young=young, stress=tension))


def pierced(
    model: Model, radius: float, pitch: float = 0.15, reach: int = 2, shift: float = 0.0
) -> Model:
    """The film with a square lattice of holes."""
    steps = range(-reach, reach + 1)
    return replace(
        model, holes=Holes(pitch * np.array([(i, j) for i in steps for j in steps]) + shift, radius)
    )


def ideal(kind: str) -> dict[str, Array]:
    """Return films whose frequencies (Hz at 1 m/s) or masses are known otherwise."""
    if kind in ("square", "rectangle"):
        width = 1.0 if kind == "square" else 1.4
        orders = [(m, n) for m in range(1, 7) for n in range(1, 7)]
        f = np.sort([np.hypot(m / width, n) / 2 for m, n in orders])[:COUNT]
        # (1,3) and (3,1) may mix
        return {"f": f, "m_eff": np.full(COUNT - 2 * (kind == "square"), width / 4 * 1e-6)}
    if kind == "circle":
        zeros = np.concatenate([jn_zeros(0, 2), *(np.repeat(jn_zeros(m, 2), 2) for m in (1, 2, 3))])
        return {"f": np.sort(zeros)[:COUNT] / (2 * np.pi)}
    if kind == "triangle":
        return {
            "f": np.sort([np.hypot(m, n) / 2 for m in range(1, 8) for n in range(1, m)])[:COUNT]
        }
    squares = {
        "hexagon": [
            7.155339133926055,
            18.131677865531,
            18.131677865531,
            32.451857514400,
            32.451857514400,
            37.491352876798,
        ],
        "L": [9.639723844021941],
    }
    return {"f": np.sqrt(squares[kind]) / (2 * np.pi)} if kind in squares else {}


def films() -> list[Film]:
    """The fifty films."""
    found = []
    for k, kind in enumerate(OUTLINES):
        bare = outline(kind)
        edges: tuple[Edge, ...] = ("clamped", "sliding", "paper")
        found += [
            Film(kind, bare, 1.0, edges[k % 3], ideal(kind)),
            Film(f"{kind}, coarse", bare, 0.6, "clamped", ideal(kind)),
        ]
        found.append(Film(f"{kind}, stiff", stiff(bare, 0.1), 1.0, edges[(k + 1) % 3]))
        if kind not in ("L", "triangle", "quadrangle"):
            found.append(Film(f"{kind}, thin plate", stiff(bare, 0.01)))
    for k, kind in enumerate(("square", "rectangle", "circle", "hexagon")):
        bare = outline(kind)
        found.append(Film(f"{kind}, holes", pierced(bare, 0.05)))
        found.append(
            Film(f"{kind}, holes, stiff", stiff(pierced(bare, 0.05), 0.01 if k < 2 else 0.03))
        )
        found.append(
            Film(
                f"{kind}, one hole",
                pierced(bare, 0.12, 1.0, 0, 0.02),
                1.0,
                "sliding" if k == 0 else "clamped",
            )
        )
        found.append(Film(f"{kind}, holes, coarse", pierced(bare, 0.05), 0.7))
    square = outline("square")
    plate = np.array(
        [35.98519111, 73.39384553, 73.39384553, 108.21650174, 131.5807726, 132.2047902]
    ) / (2 * np.pi)
    found.append(
        Film("plate without tension", stiff(square, 1.0, 0.0), 1.5, "clamped", {"f": plate})
    )
    tensions = {10.0: 39.166735, 1e2: 60.171859, 1e3: 151.454604, 1e4: 453.803717}
    for tension, omega in tensions.items():
        exact = np.array([omega]) / (2 * np.pi * np.sqrt(tension))
        found.append(
            Film(
                f"plate, Ta²/D = {tension:g}",
                stiff(square, tension**-0.5),
                1.0,
                "clamped",
                {"f": exact},
            )
        )
    return found


def numbers(modes: Modes, duffing: Nonlinearity) -> dict[str, Array]:
    """The numbers of each quantity."""
    return {
        "f": modes.frequency,
        "ratio": modes.ratio[1:],
        "m_eff": modes.effective_mass,
        "k3": duffing.k3,
        "alpha": duffing.alpha,
        "cross": cross(duffing.tensor),
    }


def cross(tensor: Array | None) -> Array:
    """Entries iijj of a tensor, for i < j."""
    if tensor is None:
        return np.empty(0)
    first, second = np.triu_indices(len(tensor), 1)
    return tensor[first, first, second, second]


def bars(modes: Modes, duffing: Nonlinearity) -> dict[str, Array]:
    """The error bars of each quantity."""
    return {
        "f": modes.frequency_error,
        "ratio": modes.ratio_error[1:],
        "m_eff": modes.effective_mass_error,
        "k3": duffing.k3_error,
        "alpha": duffing.alpha_error,
        "cross": cross(duffing.tensor_error),
    }


def reference(film: Film, like: Modes) -> dict[str, Array]:
    """Return the film's numbers, in the order of `like`.

    By closed forms where there are any, else by another degree on a finer mesh.
    """
    modes = finer_modes(film, like)
    known = numbers(modes, solve_nonlinearity(modes, film.edge, tensor=True))
    for name, exact in film.exact.items():
        known[name] = np.concatenate([exact, known[name][len(exact) :]])
    return known | {"ratio": known["f"][1:] / known["f"][0]}


def finer_modes(film: Film, like: Modes) -> Modes:
    """The film's modes by another degree on a finer mesh, in the order of `like`."""
    degree = film.reference_degree
    domain = mesh(film.model, resolution=film.resolution * film.finer, degree=degree)
    return _ordered(solve_modes(solve_prestress(domain, degree), film.count + 2, degree), like)


def _ordered(modes: Modes, like: Modes) -> Modes:
    """As many modes as `like`, the k-th of each symmetry in the place of its k-th.

    Equal frequencies come in any order.
    """
    # A whole film has no mirrors that tell them apart
    if len(modes.parity[0]) != len(like.parity[0]):
        return _taken(modes, list(range(len(like.parity))))
    members = {p: iter([k for k, q in enumerate(modes.parity) if q == p]) for p in set(like.parity)}
    return _taken(modes, [next(members[p]) for p in like.parity])


def _taken(modes: Modes, order: list[int]) -> Modes:
    return replace(
        modes,
        frequency=modes.frequency[order],
        effective_mass=modes.effective_mass[order],
        shapes=modes.shapes[order],
        parity=tuple(modes.parity[k] for k in order),
        label=tuple(modes.label[k] for k in order),
    )


def measure(film: Film) -> dict[str, tuple[Array, Array]]:
    """Error bars and true errors of the film's numbers, relative, by quantity."""
    modes = solve_with_errors(film.model, film.count, film.symmetry, film.resolution, cache=False)
    duffing = solve_nonlinearity(modes, film.edge, tensor=True)
    found = numbers(modes, duffing)
    known = reference(film, modes)
    bar = bars(modes, duffing)
    return {q: (bar[q] / np.abs(found[q]), np.abs(found[q] / known[q] - 1)) for q in QUANTITIES}
