"""Frequencies of a round film with a round electrode in its middle, by Ritz's method in the radius.

Splines of the radius times cos mθ, the stress after release in closed form, and a plate of two
kinds: no mesh, and no code of femnl but the reading of its geometry.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from scipy.interpolate import BSpline
from scipy.linalg import eigh

from femnl.core.device import Model
from femnl.io import measurement
from tests.blind.lab import laws
from tests.blind.lab.bench import Array, Cause, Noise, Values, sign
from tests.blind.lab.film import device

DEGREE = 7
SMOOTH = 1
"""Derivatives that go on across the rim of the electrode: a bending moment may jump in w″."""
PIECES = 12
"""Pieces of the radius on either side of the rim."""
GRADED = 2.0
"""Power by which pieces are narrower towards rim and edge, where the film bends sharply."""
ORDERS = 12
"""Angular orders that are solved."""


NOISE = (1.0, 3.0, 10.0, 100.0)
"""Standard deviations [Hz] of single frequencies."""
BENDING_SD = 0.1
"""Relative standard deviation of ℓ, as of other spectra."""
DIGIT = 0.1
"""Last digit [Hz] that the instrument writes."""


@dataclass(frozen=True)
class Plate:
    """One kind of film: pull Σhσ [N/m], mass Σρh [kg/m²], A and D of an isotropic laminate.

    stretch [N/m] and bend [N m]: the entries 11 and 12 of each.
    """

    pull: float
    mass: float
    stretch: tuple[float, float]
    bend: tuple[float, float]


def frequencies(model: Model, count: int, thicker: float = 0.0) -> Array:
    """Return the lowest frequencies (count,) [Hz], two of each mode with nodal diameters.

    Args: model: with one outline and one layer on top, both circles about the origin. thicker:
    relative change of the thickness of the layer.
    """
    edge = model.outline.length / 2
    rim = model.layers[0].rims[0].length / 2
    covered = _plate(model, (1 + thicker) * model.layers[0].thickness)
    bare = _plate(model, 0.0)
    squares: list[float] = []
    for order in range(ORDERS):
        found = _squares(order, covered, bare, rim, edge)
        squares += [*found, *(found if order else [])]
    return np.asarray(np.sqrt(np.sort(squares)[:count]) / (2 * np.pi))


def _plate(model: Model, thickness: float) -> Plate:
    """Return the film with a layer of some thickness [m] on it, 0 without."""
    film = model.film
    layer = model.layers[0]
    sizes = np.array([film.thickness, thickness])
    heights = np.array([0.0, (film.thickness + thickness) / 2])
    moduli = []
    for one in (film, layer):
        first = one.young / (1 - one.poisson**2)
        moduli.append([[first, one.poisson * first], [one.poisson * first, first]])
    stiff = np.array(moduli)
    stretch = np.einsum("k,kij->ij", sizes, stiff)
    couple = np.einsum("k,kij->ij", sizes * heights, stiff)
    about = np.einsum("k,kij->ij", sizes**3 / 12 + sizes * heights**2, stiff)
    bend = about - couple @ np.linalg.inv(stretch) @ couple
    return Plate(
        float(sizes @ [film.stress, layer.stress]),
        float(sizes @ [film.density, layer.density]),
        (float(stretch[0, 0]), float(stretch[0, 1])),
        (float(bend[0, 0]), float(bend[0, 1])),
    )


def _tensions(covered: Plate, bare: Plate, rim: float, edge: float, r: Array) -> Array:
    """Return N_r and N_θ (2, n) [N/m] after release: u = αr within, βr + γ/r without, u(R) = 0."""
    inner = sum(covered.stretch)
    outer = sum(bare.stretch)
    shear = bare.stretch[0] - bare.stretch[1]
    held = [
        [rim, -rim, -1 / rim],
        [0.0, edge, 1 / edge],
        [inner, -outer, shear / rim**2],
    ]
    alpha, beta, gamma = np.linalg.solve(held, [0.0, 0.0, bare.pull - covered.pull])
    within = np.full(len(r), covered.pull + inner * alpha)
    even = bare.pull + outer * beta
    uneven = shear * gamma / r**2
    on = r < rim
    return np.array([np.where(on, within, even - uneven), np.where(on, within, even + uneven)])


def _squares(order: int, covered: Plate, bare: Plate, rim: float, edge: float) -> Array:
    """Return ω² [s⁻²] of all modes of an angular order."""
    inside = rim * np.linspace(0, 1, PIECES + 1)
    inside = rim * (1 - (1 - inside / rim) ** GRADED)
    along = np.linspace(-1, 1, 2 * PIECES + 1)
    both = np.sign(along) * (1 - (1 - np.abs(along)) ** GRADED)
    outside = rim + (edge - rim) * (both + 1) / 2
    knots = np.concatenate(
        [
            np.zeros(DEGREE),
            inside,
            np.full(DEGREE - SMOOTH - 1, rim),
            outside[1:],
            np.full(DEGREE, edge),
        ]
    )
    stops = np.unique(knots)
    nodes, weights = np.polynomial.legendre.leggauss(DEGREE + 3)
    half = np.diff(stops) / 2
    r = (stops[:-1, None] + half[:, None] * (1 + nodes)).ravel()
    area = (half[:, None] * weights).ravel() * r
    size = len(knots) - DEGREE - 1
    splines = BSpline(knots, np.eye(size), DEGREE)
    # Held with its slope at the edge; smooth at the centre
    kept = slice(min(order, 2), size - 2)
    w, rise, bent = (splines(r, nu)[:, kept] for nu in range(3))
    if order == 0:
        # w′ = 0 at the centre
        w, rise, bent = (_joined(part) for part in (w, rise, bent))
    along_r, along_theta = _tensions(covered, bare, rim, edge, r)
    on = r < rim
    mass = np.where(on, covered.mass, bare.mass)
    first = np.where(on, covered.bend[0], bare.bend[0])
    second = np.where(on, covered.bend[1], bare.bend[1])
    m = order
    around = rise / r[:, None] - m**2 * w / r[:, None] ** 2
    twist = m * (rise / r[:, None] - w / r[:, None] ** 2)
    stiffness = np.zeros((w.shape[1], w.shape[1]))
    for factor, left, right in (
        (along_r, rise, rise),
        (along_theta * m**2 / r**2, w, w),
        (first, bent, bent),
        (first, around, around),
        (second, bent, around),
        (second, around, bent),
        (2 * (first - second), twist, twist),
    ):
        stiffness += left.T @ ((area * factor)[:, None] * right)
    inertia = w.T @ ((area * mass)[:, None] * w)
    return np.asarray(eigh(stiffness, inertia, eigvals_only=True))


def _joined(part: Array) -> Array:
    """Return splines whose first two, which alone have a slope at the centre, are one."""
    return np.column_stack([part[:, 0] + part[:, 1], part[:, 2:]])


class ElectrodeBench:
    """A list of the lowest modes, without labels; see `Bench`.

    All moduli change as ℓ² does, and all densities as c⁻².
    """

    def __init__(self, name: str, rng: np.random.Generator) -> None:
        self.model = device(name)
        self.count = int(rng.integers(10, 15))
        self.sd = float(rng.choice(NOISE))
        self.speed = float(np.sqrt(self.model.film.stress / self.model.film.density))
        self.unit = {"speed": self.speed, "bending": 1.0}

    def draw(self, rng: np.random.Generator) -> Values:
        """Draw c [m/s] and ℓ in units of the geometry's."""
        return {
            "speed": self.speed * (1 + 0.05 * rng.uniform(-1, 1)),
            "bending": 1 + BENDING_SD * float(np.clip(rng.standard_normal(), -2.0, 2.0)),
        }

    def clean(self, variants: list[tuple[Values, dict[str, Values]]]) -> Array:
        """Frequencies over their σ, and what is known of ℓ."""
        rows = [
            np.append(self._frequencies(base, hidden) / self.sd, base["bending"] / BENDING_SD)
            for base, hidden in variants
        ]
        return np.stack(rows)

    def measured(
        self, base: Values, hidden: dict[str, Values], rng: Noise
    ) -> dict[str, xr.Dataset]:
        """Frequencies with noise."""
        noisy = self._frequencies(base, hidden) + self.sd * rng.standard_normal(self.count)
        rounded = np.round(noisy / DIGIT) * DIGIT
        return {"spectrum": measurement.spectrum(rounded, np.full(self.count, self.sd))}

    def _frequencies(self, base: Values, hidden: dict[str, Values]) -> Array:
        film = self.model.film
        layer = self.model.layers[0]
        stiffer = base["bending"] ** 2
        model = replace(
            self.model,
            film=replace(film, young=stiffer * film.young),
            layers=(replace(layer, young=stiffer * layer.young),),
        )
        scale = base["speed"] / self.speed
        thicker = hidden.get("layer_thickness", {}).get("excess", 0.0)
        whole = scale * frequencies(model, self.count, thicker)
        much = laws.inexact(hidden, "layer_thickness")
        if not much:
            return np.asarray(whole)
        rest = scale * frequencies(model, self.count)
        return np.asarray(rest + (whole - rest) * (1 + much * laws.by_wave(rest)))


def setup(name: str, causes: tuple[str, ...], rng: np.random.Generator) -> ElectrodeBench:
    """Prepare a measurement."""
    return ElectrodeBench(name, rng)


def _thickness(rng: np.random.Generator, bench: ElectrodeBench) -> Cause:
    return Cause({"excess": 1e-3 * sign(rng)}, ("excess",), 400.0)


CAUSES: dict[str, Callable[[np.random.Generator, ElectrodeBench], Cause]] = {
    "layer_thickness": _thickness,
}
DERIVED: dict[str, str] = {
    "layer_thickness": "splines of the radius on a plate of two kinds, its stress in closed form",
}
"""How the laboratory computes a cause, other than the library does."""
