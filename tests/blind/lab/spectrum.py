"""Frequencies of a film with whatever is wrong with it, by a Ritz expansion.

The basis is the modes of the ideal membrane.
"""

from collections.abc import Callable

import numpy as np
import xarray as xr
from scipy.linalg import eigh
from scipy.optimize import linear_sum_assignment

from femnl.io import measurement
from tests.blind.lab.bench import Array, Cause, Values, sign
from tests.blind.lab.film import Membrane, device, membrane

BENDING_SD = 0.03
"""Relative standard deviation of ℓ from film to film: what thickness, modulus and stress of a
geometry are worth.
"""
POLYGON = 4.0
"""How much noisier measurements of polygons are: the average over directions in their boundary
layer is good to 1e-6.
"""
SLOPES = ("slope_x", "slope_y", "bowl")
DIGIT = 0.1
"""Last digit [Hz] that the instrument writes."""


class SpectrumBench:
    """A list of the lowest modes; see `Bench`.

    less: how much less exact the film is than instruments may be.
    """

    less = 1.0

    def __init__(self, name: str, timed: bool, rng: np.random.Generator) -> None:
        self.name = name
        self.film = device(name).film
        self.count = int(rng.integers(10, 15))
        self.sd = float(rng.choice([2.0, 3.0, 5.0]))
        self.sd *= POLYGON if device(name).outline.size is None else self.less
        self.time = 600.0 * rng.permutation(self.count) if timed or rng.uniform() < 0.5 else None
        film = self.film
        self.layer = film.thickness * np.sqrt(
            film.young / (12 * (1 - film.poisson**2) * film.stress)
        )
        self.speed = np.sqrt(film.stress / film.density)
        self.unit = {"speed": self.speed, "bending": 1.0}

    def membrane(self, layer: float = 0.0, stretch: float = 0.0) -> Membrane:
        """The film, smaller by a layer and stretched."""
        return membrane(self.name, layer, stretch)

    def draw(self, rng: np.random.Generator) -> Values:
        """Draw c [m/s] and ℓ in units of the geometry's."""
        return {
            "speed": self.speed * (1 + 0.05 * rng.uniform(-1, 1)),
            "bending": 1 + BENDING_SD * rng.standard_normal(),
        }

    def clean(self, variants: list[tuple[Values, dict[str, Values]]]) -> Array:
        """Frequencies over their σ, and what is known of ℓ."""
        return np.stack(
            [
                np.append(self._lines(base, hidden)[0] / self.sd, base["bending"] / BENDING_SD)
                for base, hidden in variants
            ]
        )

    def measured(
        self, base: Values, hidden: dict[str, Values], rng: np.random.Generator
    ) -> dict[str, xr.Dataset]:
        """Frequencies with noise, labelled by their shapes where (m,n) has a meaning."""
        frequency, names = self._lines(base, hidden)
        noisy = np.round((frequency + self.sd * rng.standard_normal(self.count)) / DIGIT) * DIGIT
        return {
            "spectrum": measurement.spectrum(
                noisy, np.full(self.count, self.sd), names or None, self.time
            )
        }

    def _lines(self, base: Values, hidden: dict[str, Values]) -> tuple[Array, list[str]]:
        film = self.film
        c2 = base["speed"] ** 2
        density = film.stress / c2
        layer = base["bending"] * self.layer
        layer = float(np.sqrt(layer**2 + hidden.get("bending_stiffness", {}).get("excess", 0.0)))
        depth = _depth(hidden.get("compliant_clamp", {}).get("depth_cubed", 0.0), layer)
        modes = self.membrane(layer - depth, hidden.get("aspect_ratio", {}).get("elongation", 0.0))
        k2 = modes.square
        plate = modes.clamped(layer, depth)
        own = np.sqrt(c2 * (plate + layer**2 * plate**2)) * (
            1 - hidden.get("hole_dispersion", {}).get("beta_area", 0.0) * k2
        )
        stiffness = np.diag(own**2) + c2 * (modes.slopes[0] + modes.slopes[1] - np.diag(k2))
        mass = np.eye(len(k2))
        if "stress_anisotropy" in hidden:
            stiffness = stiffness + c2 * hidden["stress_anisotropy"]["anisotropy"] / 2 * (
                modes.slopes[0] - modes.slopes[1]
            )
        if "shear_stress" in hidden:
            stiffness = stiffness + 2 * c2 * hidden["shear_stress"]["shear"] * modes.slopes[2]
        if "tension_gradient" in hidden:
            slopes = np.array([hidden["tension_gradient"][name] for name in SLOPES])
            slopes /= np.array([modes.half, modes.half, modes.half**2])
            stiffness = stiffness + c2 * np.tensordot(slopes, modes.graded(), 1)
        if "yielding_edge" in hidden:
            stiffness = stiffness + c2 * _yielded(modes, hidden["yielding_edge"]["compliance"])
        if "added_mass" in hidden:
            particle = hidden["added_mass"]
            shape = modes.at(np.array([particle["x"]]), np.array([particle["y"]]))[:, 0]
            mass = mass + particle["mass"] / (density * film.thickness * modes.area) * np.outer(
                shape, shape
            )
        if "gas_loading" in hidden:
            mass = mass + np.diag(
                2 * hidden["gas_loading"]["gas_density"] / (np.sqrt(k2) * density * film.thickness)
            )
        square, vectors = eigh(stiffness, mass, subset_by_index=(0, self.count - 1))
        frequency = np.sqrt(square) / (2 * np.pi)
        if "frame_mode" in hidden:
            frequency = _repelled(frequency, **hidden["frame_mode"])
        if "frequency_drift" in hidden and self.time is not None:
            frequency = frequency * (1 + hidden["frequency_drift"]["rate"] * self.time)
        return frequency, _names(modes, vectors)


def _yielded(modes: Membrane, compliance: float) -> Array:
    """What an edge that yields adds to k² between ideal modes, from its own modes.

    Each has its place in the span of the ideal ones; the few that leave it are of no measured mode.
    """
    square, overlap = modes.yielded(compliance)
    lowest = np.argsort(square)[: len(modes.square) // 2]
    left, _, right = np.linalg.svd(overlap[:, lowest], full_matrices=False)
    shapes = left @ right
    rest = np.eye(len(modes.square)) - shapes @ shapes.T
    plain = np.diag(modes.square)
    return np.asarray((shapes * square[lowest]) @ shapes.T + rest @ plain @ rest - plain)


def _depth(cubed: float, layer: float) -> float:
    """Return the depth δ of an edge that gives way, from (δ − ℓ)³ + ℓ³.

    That is what it does to the frequencies of a square, alike on all sides.
    """
    return float(layer + np.cbrt(cubed - layer**3)) if cubed else 0.0


def _names(modes: Membrane, vectors: Array) -> list[str]:
    """(m,n) by shape, each once."""
    if not len(modes.orders):
        return []
    lowest = np.argsort(modes.square, kind="stable")[: vectors.shape[1] + 6]
    mine, theirs = linear_sum_assignment(-(vectors[lowest].T ** 2))
    return [f"{m},{n}" for m, n in modes.orders[lowest[theirs[np.argsort(mine)]]]]


def _repelled(frequency: Array, coupling_square: float, frame_frequency: float) -> Array:
    """Frequencies of the film's part of two coupled oscillators, mode by mode."""
    half = (frequency - frame_frequency) / 2
    return np.asarray(
        (frequency + frame_frequency) / 2 + np.sign(half) * np.sqrt(half**2 + coupling_square)
    )


def setup(name: str, causes: tuple[str, ...], rng: np.random.Generator) -> SpectrumBench:
    """Prepare a measurement."""
    return SpectrumBench(name, "frequency_drift" in causes, rng)


def _simple(
    spec: str, low: float, most: float, signed: bool = False
) -> Callable[[np.random.Generator, SpectrumBench], Cause]:
    def draw(rng: np.random.Generator, bench: SpectrumBench) -> Cause:
        return Cause({spec: low * (sign(rng) if signed else 1)}, (spec,), most / low)

    return draw


def _stiffness(rng: np.random.Generator, bench: SpectrumBench) -> Cause:
    return Cause({"excess": 1e-2 * bench.layer**2}, ("excess",), min(1e3, 2e-10 / bench.layer**2))


def _particle(rng: np.random.Generator, bench: SpectrumBench) -> Cause:
    modes = bench.membrane()
    size = modes.inner if len(modes.orders) else (modes.half, modes.half)
    x, y = (float(sign(rng) * rng.uniform(0.08, 0.42) * side) for side in size)
    film = bench.film
    whole = film.density * film.thickness * modes.area
    return Cause({"mass": 1e-5 * whole, "x": x, "y": y}, ("mass",), 1e3)


def _frame(rng: np.random.Generator, bench: SpectrumBench) -> Cause:
    lines = np.sort(bench.clean([(dict(bench.unit), {})])[0][:-1]) * bench.sd
    k = int(rng.integers(0, len(lines)))
    distance = sign(rng) * np.exp(rng.uniform(np.log(3e-4), np.log(1e-2)))
    return Cause(
        {"coupling_square": 1e3, "frame_frequency": float(lines[k] * (1 + distance))},
        ("coupling_square",),
        1e4,
    )


def _gradient(rng: np.random.Generator, bench: SpectrumBench) -> Cause:
    slopes = rng.standard_normal(3)
    slopes = 1e-3 * slopes / np.linalg.norm(slopes)
    return Cause(
        dict(zip(SLOPES, map(float, slopes), strict=True)),
        SLOPES,
        50.0,
    )


CAUSES: dict[str, Callable[[np.random.Generator, SpectrumBench], Cause]] = {
    "added_mass": _particle,
    "aspect_ratio": _simple("elongation", 1e-4, 2e-2, signed=True),
    "bending_stiffness": _stiffness,
    "compliant_clamp": _simple("depth_cubed", 1e-18, 2e-15),
    "frame_mode": _frame,
    "frequency_drift": _simple("rate", 1e-8, 9e-7, signed=True),
    "gas_loading": _simple("gas_density", 1e-2, 3.0),
    "hole_dispersion": _simple("beta_area", 1e-14, 1e-12),
    "shear_stress": _simple("shear", 1e-4, 3e-2),
    "stress_anisotropy": _simple("anisotropy", 1e-4, 5e-2, signed=True),
    "tension_gradient": _gradient,
    "yielding_edge": _simple("compliance", 1e-7, 150.0),
}
DERIVED = {
    "tension_gradient": "stress relaxed by Legendre polynomials (rectangle), by quadratic "
    "triangles of its own (polygon) or quadrilaterals (holes), not by the library's elements",
    "yielding_edge": "stress and modes by Legendre polynomials over the whole rectangle",
    "stress_anisotropy": "sines with different stress along x and y, whose plate layer is its own",
    "shear_stress": "products of sines in closed form",
    "aspect_ratio": "a rectangle of other sides",
    "compliant_clamp": "plate waves between springs, with the layer of each wave vector",
}
"""How the laboratory computes each cause, by another way than the library's."""
