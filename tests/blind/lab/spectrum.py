"""Frequencies of a film with whatever is wrong with it, by a Ritz expansion.

The basis is the modes of the ideal membrane.
"""

from collections.abc import Callable
from functools import cached_property

import numpy as np
import xarray as xr
from scipy.linalg import eigh
from scipy.optimize import linear_sum_assignment

from femnl.io import measurement
from tests.blind.lab import laws
from tests.blind.lab.bench import Array, Cause, Noise, Values, sign
from tests.blind.lab.corners import cut
from tests.blind.lab.film import Membrane, device, membrane
from tests.blind.lab.surroundings import (
    KEPT,
    Lossy,
    dashpot,
    gas_above,
    gas_below,
    rigid,
    trapped,
)

BENDING_SD = 0.1
"""Relative standard deviation of ℓ from film to film: what thickness, modulus and stress of a
geometry are worth; no film is further off than `WRONG`.
"""
WRONG = 3.0
NOISE = (1.0, 3.0, 10.0, 100.0, 1000.0)
"""Standard deviations [Hz] of single frequencies, from a locked loop to a broad line."""
POLYGON = 4.0
"""How much noisier measurements of polygons are: the average over directions in their boundary
layer is good to 1e-6.
"""
RATED = {"clamp_loss", "gas_damping"}
"""Causes that frequencies do not show."""
LOSS_SD = 0.01
"""Relative standard deviation of quality factors."""
STEP = 1e-3
"""Relative change of ℓ from which the part of bending in the energy is taken."""
SLOPES = ("slope_x", "slope_y", "bowl")
DIGIT = 0.1
"""Last digit [Hz] that the instrument writes."""


Lines = tuple[Array, Array, list[str]]
OWN_LAW = ("added_mass", "frame_mode", "frequency_drift")
"""Causes whose second law is one of their own, see `laws`."""


class SpectrumBench:
    """A list of the lowest modes; see `Bench`.

    less: how much less exact the film is than instruments may be.
    """

    less = 1.0

    def __init__(self, name: str, causes: tuple[str, ...], rng: np.random.Generator) -> None:
        timed = "frequency_drift" in causes
        # A stream of its own, so that what else is drawn does not depend on it
        self.own = rng.spawn(1)[0]
        self.rating: Noise = self.own
        self.rated = bool(RATED & set(causes)) or self.own.uniform() < 1 / 3
        self.name = name
        model = device(name)
        self.film = model.film
        self.gap = np.inf if model.stack is None else model.stack.layers[model.stack.gap].thickness
        self.loss = float(np.exp(self.own.uniform(*np.log((5e-5, 5e-4)))))
        self.pressure = 0.0
        self.count = int(rng.integers(10, 15))
        self.sd = float(rng.choice(NOISE))
        self.sd *= POLYGON if device(name).outline.size is None else self.less
        self.time = 600.0 * rng.permutation(self.count) if timed or rng.uniform() < 0.5 else None
        film = self.film
        self.layer = film.thickness * np.sqrt(
            film.young / (12 * (1 - film.poisson**2) * film.stress)
        )
        self.speed = np.sqrt(film.stress / film.density)
        self.unit = {"speed": self.speed, "bending": 1.0}
        if self.rated:
            self.unit["loss"] = self.loss

    def membrane(self, layer: float = 0.0, stretch: float = 0.0) -> Membrane:
        """The film, smaller by a layer and stretched."""
        return membrane(self.name, layer, stretch)

    def draw(self, rng: np.random.Generator) -> Values:
        """Draw c [m/s] and ℓ in units of the geometry's."""
        return {
            "speed": self.speed * (1 + 0.05 * rng.uniform(-1, 1)),
            "bending": 1 + BENDING_SD * float(np.clip(rng.standard_normal(), -WRONG, WRONG)),
            **({"loss": self.loss} if self.rated else {}),
        }

    def clean(self, variants: list[tuple[Values, dict[str, Values]]]) -> Array:
        """Frequencies over their σ, what is known of ℓ, and quality factors over theirs."""
        rows = []
        for base, hidden in variants:
            frequency, loss, _ = self._lines(base, hidden)
            rated: Array = -np.log(loss) / LOSS_SD if self.rated else np.empty(0)
            rows.append(
                np.concatenate([frequency / self.sd, [base["bending"] / BENDING_SD], rated])
            )
        return np.stack(rows)

    def measured(
        self, base: Values, hidden: dict[str, Values], rng: Noise
    ) -> dict[str, xr.Dataset]:
        """Frequencies with noise, labelled by their shapes where (m,n) has a meaning."""
        frequency, loss, names = self._lines(base, hidden)
        noisy = np.round((frequency + self.sd * rng.standard_normal(self.count)) / DIGIT) * DIGIT
        quality, sd = None, None
        if self.rated:
            sd = LOSS_SD / loss
            quality = np.round(1 / loss + sd * self.rating.standard_normal(self.count))
        group = measurement.spectrum(
            noisy,
            np.full(self.count, self.sd),
            names or None,
            self.time,
            quality,
            sd,
        )
        if self.pressure:
            group = group.assign_attrs(pressure=self.pressure)
        return {"spectrum": group}

    @cached_property
    def rigid(self) -> Array:
        """What each mode has of the rigid motions of the film, see `rigid`."""
        return rigid(self.membrane())

    def _lines(self, base: Values, hidden: dict[str, Values]) -> Lines:
        """Return frequencies, 1/Q and names of the lowest modes."""
        for name, values in hidden.items():
            much = laws.inexact(hidden, name)
            if much and name not in OWN_LAW:
                whole = hidden | {name: laws.first(values)}
                rest = {other: known for other, known in hidden.items() if other != name}
                return _by_wave(self._lines(base, whole), self._lines(base, rest), much)
        frequency, loss, names = self._first_law(base, hidden)
        if "frequency_drift" in hidden and self.time is not None:
            time = np.asarray(self.time, np.float64)
            drifted = laws.relaxed(time, time.max(), laws.inexact(hidden, "frequency_drift"))
            frequency = frequency * (1 + hidden["frequency_drift"]["rate"] * drifted)
        return frequency, loss, names

    def _first_law(self, base: Values, hidden: dict[str, Values]) -> Lines:
        film = self.film
        c2 = base["speed"] ** 2
        density = film.stress / c2
        layer = base["bending"] * self.layer
        layer = float(np.sqrt(layer**2 + hidden.get("bending_stiffness", {}).get("excess", 0.0)))
        depth = _depth(hidden.get("compliant_clamp", {}).get("depth_cubed", 0.0), layer)
        stretch = hidden.get("aspect_ratio", {}).get("elongation", 0.0)
        modes = self.membrane(layer - depth, stretch)
        k2 = modes.square
        plate = modes.clamped(layer, depth)
        own = np.sqrt(c2 * (plate + layer**2 * plate**2)) * _slowed(
            np.sqrt(k2), hidden.get("hole_dispersion", {}).get("beta_area", 0.0)
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
            stiffness = stiffness + c2 * _yielded(
                modes, hidden["yielding_edge"]["compliance"], layer
            )
        if "added_mass" in hidden:
            particle = hidden["added_mass"]
            dx, dy, part = laws.patch(laws.inexact(hidden, "added_mass"))
            shape = modes.at(particle["x"] + dx, particle["y"] + dy)
            mass = mass + particle["mass"] / (density * film.thickness * modes.area) * (
                (shape * part) @ shape.T
            )
        if "rounded_corners" in hidden:
            stiffness = stiffness + c2 * cut(modes, hidden["rounded_corners"]["radius"])
        if "gas_loading" in hidden:
            above = gas_above(modes.inner, int(np.sqrt(len(k2))))
            known = np.isfinite(self.gap)
            below = np.diag(gas_below(np.sqrt(k2), self.gap)) if known else above
            share = hidden["gas_loading"]["gas_density"] / (density * film.thickness)
            mass = mass + share * (above + below)
        lossy = np.zeros_like(stiffness)
        if self.rated:
            more = self.membrane(layer * (1 + STEP) - depth, stretch)
            moved = more.clamped(layer * (1 + STEP), depth)
            lossy = np.diag(own**2 * base["loss"] * _bending_share(plate, moved, layer))
            lossy = _pulled(lossy, modes, hidden.get("stress_anisotropy", {}))
        if "trapped_gas" in hidden:
            gas = hidden["trapped_gas"]
            spring = gas["pressure"] / (density * film.thickness * self.gap)
            held = trapped(own**2, spring, gas["escape_time"] * k2.min() / k2)
            stiffness = stiffness + np.diag(held.real - own**2)
            lossy = lossy + np.diag(held.imag)
        if "gas_damping" in hidden:
            unit = hidden["gas_damping"]["per_pressure"] * self.pressure * own.min()
            lossy = lossy + np.diag(unit * own)
        if lossy.any() or "frame_mode" in hidden:
            _, basis = eigh(stiffness, mass, subset_by_index=(0, min(KEPT, len(k2)) - 1))
            film_and_chip = Lossy(
                basis.T @ stiffness @ basis + 1j * (basis.T @ lossy @ basis),
                basis.T @ mass @ basis,
                self.rigid @ basis,
            )
            frequency, loss, turned = film_and_chip.solve(
                hidden.get("frame_mode", {}), hidden.get("clamp_loss", {}), self.count
            )
            vectors = basis @ turned
        else:
            square, vectors = eigh(stiffness, mass, subset_by_index=(0, self.count - 1))
            frequency = np.sqrt(square) / (2 * np.pi)
            loss = np.zeros_like(frequency)
        return frequency, loss, _names(modes, vectors)


def _by_wave(whole: Lines, rest: Lines, much: float) -> Lines:
    """Let a cause act more on short waves than on long ones, to the same sum over all of them."""
    factor = 1 + much * laws.by_wave(rest[0])
    frequency = rest[0] + (whole[0] - rest[0]) * factor
    loss = whole[1]
    if rest[1].all():
        loss = rest[1] * (whole[1] / rest[1]) ** factor
    return frequency, loss, whole[2]


def _bending_share(plate: Array, more: Array, layer: float) -> Array:
    """Return ∂ ln ω²/∂ ln ℓ² of each mode at a fixed tension: the part of bending in its energy."""
    before = plate + layer**2 * plate**2
    after = more + (layer * (1 + STEP)) ** 2 * more**2
    return np.asarray(np.log(after / before) / (2 * np.log1p(STEP)))


def _pulled(lossy: Array, modes: Membrane, values: Values) -> Array:
    """Let the layers along each pair of sides bend as √(tension across them)."""
    if not values:
        return lossy
    anisotropy = values["anisotropy"]
    root = np.sqrt(np.diag(lossy))
    x, y = modes.slopes[0], modes.slopes[1]
    each = np.sqrt(np.diag(x + y))
    bent = np.sqrt(1 + anisotropy / 2) * x + np.sqrt(1 - anisotropy / 2) * y
    return np.asarray(np.outer(root / each, root / each) * bent)


def _yielded(modes: Membrane, compliance: float, layer: float) -> Array:
    """What an edge that yields adds to k² between ideal modes, from its own modes and layer.

    Each has its place in the span of the ideal ones; the few that leave it are of no measured mode.
    """
    square, overlap, thicker = modes.yielded(compliance)
    lowest = np.argsort(square)[: len(modes.square) // 2]
    left, _, right = np.linalg.svd(overlap[:, lowest], full_matrices=False)
    shapes = left @ right
    rest = np.eye(len(modes.square)) - shapes @ shapes.T
    plain = np.diag(modes.square)
    moved = (shapes * square[lowest]) @ shapes.T + rest @ plain @ rest - plain
    return np.asarray(moved + layer * thicker)


def _depth(cubed: float, layer: float) -> float:
    """Return the depth δ of an edge that gives way, from (δ − ℓ)³ + ℓ³.

    That is what it does to the frequencies of a square, alike on all sides.
    """
    return float(layer + np.cbrt(cubed - layer**3)) if cubed else 0.0


def _slowed(wavenumber: Array, area: float) -> Array:
    """Return by what factor masses on a string, 1/24 of whose spacing squared is that, slow waves.

    sin x/x at all orders, and sinh x/x for less than no spacing.
    """
    x = wavenumber * np.sqrt(6 * abs(area)) + 1e-12
    return np.asarray(np.sin(x) / x if area >= 0 else np.sinh(x) / x)


def _names(modes: Membrane, vectors: Array) -> list[str]:
    """(m,n) by shape, each once."""
    if not len(modes.orders):
        return []
    lowest = np.argsort(modes.square, kind="stable")[: vectors.shape[1] + 6]
    mine, theirs = linear_sum_assignment(-(vectors[lowest].T ** 2))
    return [f"{m},{n}" for m, n in modes.orders[lowest[theirs[np.argsort(mine)]]]]


def setup(name: str, causes: tuple[str, ...], rng: np.random.Generator) -> SpectrumBench:
    """Prepare a measurement."""
    return SpectrumBench(name, causes, rng)


def simple(
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
    lines = np.sort(bench._lines(dict(bench.unit), {})[0])
    motion = int(rng.integers(0, 3))
    shares = bench.rigid[motion][np.argsort(bench.membrane().square, kind="stable")]
    answering = np.flatnonzero(shares[: len(lines)] ** 2 > 1e-3)
    k = int(rng.choice(answering))
    distance = sign(rng) * np.exp(rng.uniform(np.log(3e-4), np.log(1e-2)))
    values = {"heave": 0.0, "tilt_x": 0.0, "tilt_y": 0.0}
    name = list(values)[motion]
    values |= {
        name: 3e-5,
        "frame_frequency": float(lines[k] * (1 + distance)),
        "frame_loss": float(np.exp(rng.uniform(np.log(1e-4), np.log(1e-2)))),
    }
    return Cause(values, (name,), 300.0)


def _gas(rng: np.random.Generator, bench: SpectrumBench) -> Cause:
    """Draw thin gas of a usual kind, at a pressure that shows beside the film's own loss."""
    molar_mass = float(rng.choice([0.004, 0.028, 0.029, 0.040, 0.146]))
    inertia = bench.film.density * bench.film.thickness
    frequency, loss, _ = bench._lines(dict(bench.unit), {})
    first = 2 * np.pi * frequency.min() * inertia
    per_pressure = dashpot(molar_mass, rng.uniform(285, 305)) / first * rng.uniform(0.8, 1.2)
    part = np.exp(rng.uniform(np.log(0.2), np.log(3.0)))
    bench.pressure = float(part * loss.min() / per_pressure)
    return Cause({"per_pressure": per_pressure}, ())


def _trapped(rng: np.random.Generator, bench: SpectrumBench) -> Cause:
    frequency = bench._lines(dict(bench.unit), {})[0].min()
    turn = np.exp(rng.uniform(np.log(3.0), np.log(1e3)))
    values = {"pressure": 1.0, "escape_time": float(turn / (2 * np.pi * frequency))}
    return Cause(values, ("pressure",), 3e4)


def _clamp(rng: np.random.Generator, bench: SpectrumBench) -> Cause:
    values = {"monopole": 1e-8, "dipole": float(rng.uniform(0.0, 0.3))}
    return Cause(values, ("monopole",), 1e4)


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
    "aspect_ratio": simple("elongation", 1e-4, 2e-2, signed=True),
    "bending_stiffness": _stiffness,
    "compliant_clamp": simple("depth_cubed", 1e-18, 1.2e-16),
    "clamp_loss": _clamp,
    "frame_mode": _frame,
    "gas_damping": _gas,
    "frequency_drift": simple("rate", 1e-8, 9e-7, signed=True),
    "gas_loading": simple("gas_density", 1e-4, 1.0),
    "shear_stress": simple("shear", 1e-4, 3e-2),
    "stress_anisotropy": simple("anisotropy", 1e-4, 5e-2, signed=True),
    "tension_gradient": _gradient,
    "trapped_gas": _trapped,
    "yielding_edge": simple("compliance", 1e-7, 1.5e-5),
}
DERIVED: dict[str, str] = {
    "added_mass": "a sum over products of sines, in closed form",
    "aspect_ratio": "a rectangle of other sides",
    "bending_stiffness": "plate waves with the layer of each wave vector",
    "clamp_loss": "eigenvalues of film and yielding chip together, each at its own frequency",
    "compliant_clamp": "plate waves between springs, with the layer of each wave vector",
    "frame_mode": "eigenvalues of all modes and the frame in one complex problem",
    "frequency_drift": "a rate times the time of acquisition",
    "gas_damping": "momentum of Maxwell's molecules that bounce off a moving plate, by quadrature",
    "gas_loading": "above by correlations of sines in polar coordinates, below by differences in "
    "height",
    "shear_stress": "products of sines in closed form",
    "stress_anisotropy": "sines with different stress along x and y, whose plate layer is its own",
    "tension_gradient": "stress relaxed by Legendre polynomials (rectangle), by quadratic "
    "triangles of its own (polygon) or quadrilaterals (holes), not by the library's elements",
    "trapped_gas": "roots of the motion of film and pressure together",
    "yielding_edge": "stress and modes by Legendre polynomials over the whole rectangle",
}
"""How the laboratory computes a cause, other than the library does."""
