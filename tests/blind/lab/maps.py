"""Maps of harmonics: shapes of an ideal membrane smaller by ℓ on every side, v(t) sampled over a period, an FFT."""

from collections.abc import Callable
from functools import cache, lru_cache

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from femnl import geometry, measurement
from femnl.types.device import Stack
from tests.blind.lab.bench import Array, Cause, Values, sign
from tests.blind.lab.film import Membrane, membrane

WAVELENGTH = 632.8e-9
SAMPLES, ORDERS = 96, 6
MODES = 12
SPOT, WEIGHT = np.polynomial.hermite_e.hermegauss(4)


@lru_cache(maxsize=32)
def _shapes(name: str, x: bytes, y: bytes) -> Array:
    """Shapes of the lowest modes at points, each with a maximum of 1."""
    return np.asarray(_film(name).at(np.frombuffer(x), np.frombuffer(y), MODES) / _largest(name)[:, None])


@cache
def _film(name: str) -> Membrane:
    film = geometry.load(name).film
    return membrane(name, film.thickness * np.sqrt(film.young / (12 * (1 - film.poisson**2) * film.stress)))


@cache
def _largest(name: str) -> Array:
    x, y = np.meshgrid(*[np.linspace(-1, 1, 161) * _film(name).half] * 2)
    return np.asarray(np.abs(_film(name).at(x.ravel(), y.ravel(), MODES)).max(axis=1))


class MapBench:
    """Six harmonics over a film and a fifth beyond; see `Bench`."""

    def __init__(self, name: str, rng: np.random.Generator, points: int = 41) -> None:
        self.name, film = name, geometry.load(name).film
        self.frequencies = np.sqrt(np.sort(_film(name).square)[:MODES] * film.stress / film.density) / (2 * np.pi)
        self.axis = np.linspace(-1.2, 1.2, points) * _film(name).half
        self.noise, self.stack = 3e-4, geometry.load(name).stack
        self.gap = self.stack.layers[self.stack.gap].thickness if self.stack else 0.0
        self.drive = float(self.frequencies[0] * (1 + 1e-3 * rng.uniform(-1, 1)))
        self.unit = {"amplitude": 1e-8, "contrast": 0.02, "theta": 1.0, "phase": 1.0, "x": 1e-6, "y": 1e-6}

    def draw(self, rng: np.random.Generator) -> Values:
        """Draw the amplitude [m], contrast [V], phases of fringe and motion [rad], and where the film lies on the stage [m]."""
        return {
            "amplitude": rng.uniform(1.5e-7, 4.5e-7),
            "contrast": 0.02,
            "theta": rng.uniform(0.2, 1.35),
            "phase": rng.uniform(-np.pi, np.pi),
            "x": rng.uniform(-3e-6, 3e-6),
            "y": rng.uniform(-3e-6, 3e-6),
        }

    def clean(self, variants: list[tuple[Values, dict[str, Values]]]) -> Array:
        """Both quadratures over their σ."""
        rows = [self._harmonics(base, hidden).ravel() / self.noise for base, hidden in variants]
        return np.stack([np.concatenate([row.real, row.imag]) for row in rows])

    def measured(self, base: Values, hidden: dict[str, Values], rng: np.random.Generator) -> xr.Dataset:
        """Quadratures with noise, to a microvolt."""
        values = self._harmonics(base, hidden)
        noise = rng.standard_normal((2, *values.shape))
        noisy = np.round(values + self.noise * (noise[0] + 1j * noise[1]), 6)
        where = {"noise_sd": self.noise, "wavelength": WAVELENGTH, "drive_frequency": self.drive}
        return measurement.harmonic_map(self.axis, self.axis, np.arange(1, ORDERS + 1), noisy, **where)

    def _harmonics(self, base: Values, hidden: dict[str, Values]) -> NDArray[np.complex128]:
        x, y = np.meshgrid(self.axis - base["x"], self.axis - base["y"])
        if "stage_rotation" in hidden:
            turn = np.exp(-1j * hidden["stage_rotation"]["angle"]) * (x + 1j * y)
            x, y = turn.real, turn.imag
        if "stage_scale" in hidden:
            x, y = x * (1 + hidden["stage_scale"]["stretch_x"]), y * (1 + hidden["stage_scale"]["stretch_y"])
        if "finite_spot" in hidden:
            sd, total = hidden["finite_spot"]["radius"] / 2, WEIGHT.sum() ** 2
            values = sum(
                a * b / total * self._read(x + sd * dx, y + sd * dy, base, hidden)
                for a, dx in zip(WEIGHT, SPOT, strict=True)
                for b, dy in zip(WEIGHT, SPOT, strict=True)
            )
        else:
            values = self._read(x, y, base, hidden)
        order = np.arange(1, ORDERS + 1)[:, None, None]
        values = np.asarray(values) * np.exp(1j * order * base["phase"])
        omega = 2 * np.pi * self.drive
        if "trigger_jitter" in hidden:  # the average over normal errors of the time zero
            errors, share = np.polynomial.hermite_e.hermegauss(24)
            turns = np.exp(-1j * order[..., None] * omega * hidden["trigger_jitter"]["sd"] * errors)
            values = values * (turns @ (share / share.sum()))
        if "detector_bandwidth" in hidden:
            values = values / (1 + 1j * order * omega * hidden["detector_bandwidth"]["time_constant"])
        return np.asarray(values)

    def _read(self, x: Array, y: Array, base: Values, hidden: dict[str, Values]) -> NDArray[np.complex128]:
        """Harmonics at points of the film, for a motion whose phase is zero."""
        shapes = _shapes(self.name, x.tobytes(), y.tobytes()).reshape(MODES, *x.shape)
        shape = shapes[0]
        theta = np.full(x.shape, base["theta"])
        if "phase_tilt" in hidden:
            theta = theta + hidden["phase_tilt"]["gradient_x"] * x + hidden["phase_tilt"]["gradient_y"] * y
        if "static_bow" in hidden:
            theta = theta + hidden["static_bow"]["depth"] * np.abs(shape)
        for k in range(1, 5):
            if "mode_admixture" in hidden:
                shape = shape + hidden["mode_admixture"][f"e{k}"] * shapes[k]
        tau = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
        u = base["amplitude"] * shape[..., None] * np.cos(tau)
        if "mechanical_overtones" in hidden:
            sung = hidden["mechanical_overtones"]
            for n in (2, 3):
                k = int(np.argmin(np.abs(self.frequencies - n * self.frequencies[0])))
                swing = sung[f"cos{n}"] * np.cos(n * tau) + sung[f"sin{n}"] * np.sin(n * tau)
                u = u + shapes[k][..., None] * swing
        v = self._lit(u, theta, base, hidden)
        if "detector_saturation" in hidden:
            limit = base["contrast"] * (1 - hidden["detector_saturation"]["clipped"])
            v = np.clip(v, -limit, limit)
        return np.asarray(2 / SAMPLES * np.moveaxis(np.fft.fft(v, axis=-1)[..., 1 : ORDERS + 1], -1, 0))

    def _lit(self, u: Array, theta: Array, base: Values, hidden: dict[str, Values]) -> Array:
        if "multilayer_fringe" not in hidden or self.stack is None:
            return np.asarray(base["contrast"] * np.cos(4 * np.pi / WAVELENGTH * u + theta[..., None]))
        gap = hidden["multilayer_fringe"]["gap"]
        period = np.linspace(0, WAVELENGTH / 2, 512, endpoint=False)
        whole = reflection(self.stack, gap + period)
        first = 2 * abs(np.mean(whole * np.exp(4j * np.pi * period / WAVELENGTH)))
        return np.asarray(base["contrast"] / first * (reflection(self.stack, gap + u) - whole.mean()))


def reflection(stack: Stack, gap: Array) -> Array:
    """R of the stack at normal incidence, layer by layer from the wafer up: r = (r₀ + r e^{−2ikd})/(1 + r₀ r e^{−2ikd})."""
    index = [_index(layer.index) for layer in stack.layers]
    inner = np.zeros(np.shape(gap), complex)
    for k in range(len(index) - 2, -1, -1):
        face = (index[k] - index[k + 1]) / (index[k] + index[k + 1])
        if k + 1 < len(index) - 1:
            depth = gap if k + 1 == stack.gap else stack.layers[k + 1].thickness
            inner = inner * np.exp(-4j * np.pi / WAVELENGTH * index[k + 1] * depth)
        inner = (face + inner) / (1 + face * inner)
    return np.asarray(np.abs(inner) ** 2)


def _index(table: tuple[tuple[float, complex], ...]) -> complex:
    wavelengths, values = zip(*sorted(table, key=lambda row: row[0]), strict=True)
    return complex(np.interp(WAVELENGTH, wavelengths, np.array(values)))


def setup(name: str, causes: tuple[str, ...], rng: np.random.Generator) -> MapBench:
    """Prepare a measurement."""
    return MapBench(name, rng)


def _vector(names: tuple[str, ...], size: float, most: float) -> Callable[[np.random.Generator, MapBench], Cause]:
    def draw(rng: np.random.Generator, bench: MapBench) -> Cause:
        direction = rng.standard_normal(len(names))
        direction = size * direction / np.linalg.norm(direction)
        return Cause(dict(zip(names, map(float, direction), strict=True)), names, most)

    return draw


def _one(knob: str, size: float, most: float) -> Callable[[np.random.Generator, MapBench], Cause]:
    return lambda rng, bench: Cause({knob: size}, (knob,), most)


def _stack(rng: np.random.Generator, bench: MapBench) -> Cause:
    return Cause({"gap": bench.gap + float(rng.uniform(-1, 1)) * WAVELENGTH / 4}, ())


CAUSES: dict[str, Callable[[np.random.Generator, MapBench], Cause]] = {
    "detector_bandwidth": _one("time_constant", 3e-9, 20.0),
    "detector_saturation": _one("clipped", 0.05, 10.0),
    "finite_spot": _one("radius", 2e-6, 5.0),
    "mechanical_overtones": _vector(("cos2", "sin2", "cos3", "sin3"), 1e-9, 60.0),
    "mode_admixture": _vector(("e1", "e2", "e3", "e4"), 1e-3, 150.0),
    "multilayer_fringe": _stack,
    "phase_tilt": _vector(("gradient_x", "gradient_y"), 10.0, 1000.0),
    "stage_rotation": lambda rng, bench: Cause({"angle": 1e-3 * sign(rng)}, ("angle",), 200.0),
    "stage_scale": _vector(("stretch_x", "stretch_y"), 1e-3, 100.0),
    "static_bow": lambda rng, bench: Cause({"depth": 1e-2 * sign(rng)}, ("depth",), 200.0),
    "trigger_jitter": _one("sd", 3e-9, 25.0),
}
