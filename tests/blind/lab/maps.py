"""Maps of harmonics: shapes of a membrane, v(t) over a period, and an FFT.

The membrane is smaller by ℓ on every side, with the layer of a plate at its edge.

Where the film has holes, nothing is read over them. A restoring force of second order bends the
motion itself: one period of the free oscillator, in time steps.
"""

from collections.abc import Callable
from functools import cache, lru_cache

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from femnl.io import measurement
from tests.blind.lab import laws
from tests.blind.lab.bench import Array, Cause, Noise, Values, one, sign, vector
from tests.blind.lab.drum import Drum, drum
from tests.blind.lab.film import Membrane, device, membrane
from tests.blind.lab.motion import DWELL, bent, drifting
from tests.blind.lab.optics import fringe, largest, low_passed

WAVELENGTH = 632.8e-9
SAMPLES = 96
ORDERS = 6
MODES = 12
SPOT = np.linspace(-3.6, 3.6, 13)
"""Points of the laser spot along each axis, in units of its sd: even steps, since the film's edge
is a kink of the signal.
"""
HOLED = ("perforated",)
"""Films with holes, over which nothing is read."""


@lru_cache(maxsize=700)  # every point of a spot at its place, beside, and for another size
def _shapes(name: str, x: bytes, y: bytes) -> Array:
    """Shapes of the lowest modes at points, each with a maximum of 1."""
    return np.asarray(
        _film(name).held(np.frombuffer(x), np.frombuffer(y), MODES, _layer(name))
        / _largest(name)[:, None]
    )


def _layer(name: str) -> float:
    film = device(name).film
    return film.thickness * float(np.sqrt(film.young / (12 * (1 - film.poisson**2) * film.stress)))


@cache
def _film(name: str) -> Membrane:
    return membrane(name, _layer(name)) if name not in HOLED else drum(_layer(name))


@cache
def _largest(name: str) -> Array:
    """Value of each mode where it is largest."""
    x, y = np.meshgrid(*[np.linspace(-1, 1, 161) * _film(name).half] * 2)
    values = _film(name).at(x.ravel(), y.ravel(), MODES)
    return np.asarray(values[np.arange(MODES), np.argmax(np.abs(values), axis=1)])


class MapBench:
    """Six harmonics over a film and a fifth beyond; see `Bench`."""

    def __init__(
        self,
        name: str,
        causes: tuple[str, ...],
        rng: np.random.Generator,
        points: int = 41,
        wavelength: float = WAVELENGTH,
    ) -> None:
        self.wavelength = wavelength
        self.driven = 0.5 if "crosstalk" in causes else None
        self.name = name
        film = device(name).film
        self.frequencies = np.sqrt(
            np.sort(_film(name).square)[:MODES] * film.stress / film.density
        ) / (2 * np.pi)
        self.axis = np.linspace(-1.2, 1.2, points) * _film(name).half
        self.time = DWELL * np.arange(points**2.0).reshape(points, points)
        self.noise = 3e-4
        self.spot = SPOT
        self.stack = device(name).stack
        self.gap = self.stack.layers[self.stack.gap].thickness if self.stack else 0.0
        self.thickness = device(name).film.thickness
        self.drive = float(self.frequencies[0] * (1 + 1e-3 * rng.uniform(-1, 1)))
        self.unit = {
            "amplitude": 1e-8,
            "contrast": 0.02,
            "theta": 1.0,
            "phase": 1.0,
            "x": 1e-6,
            "y": 1e-6,
        }

    def draw(self, rng: np.random.Generator) -> Values:
        """Draw amplitude [m], contrast [V], phases [rad] of fringe and motion, and place [m]."""
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
        rows = np.stack(
            [self._harmonics(base, hidden).ravel() / self.noise for base, hidden in variants]
        )
        # A point that comes to lie over a hole tells nothing
        seen = np.where(np.isfinite(rows).all(axis=0), rows, 0)
        return np.concatenate([seen.real, seen.imag], axis=1)

    def measured(
        self, base: Values, hidden: dict[str, Values], rng: Noise
    ) -> dict[str, xr.Dataset]:
        """Quadratures with noise, to a microvolt."""
        values = self._harmonics(base, hidden)
        noise = rng.standard_normal((2, *values.shape))
        noisy = np.round(values + self.noise * (noise[0] + 1j * noise[1]), 6)
        where = {
            "noise_sd": self.noise,
            "wavelength": self.wavelength,
            "drive_frequency": self.drive,
            "drive": self.driven,
        }
        return {
            "map": measurement.harmonic_map(
                self.axis, self.axis, np.arange(1, ORDERS + 1), noisy, time=self.time, **where
            )
        }

    def _harmonics(self, base: Values, hidden: dict[str, Values]) -> NDArray[np.complex128]:
        x, y = np.meshgrid(self.axis - base["x"], self.axis - base["y"])
        if "stage_rotation" in hidden:
            angle = hidden["stage_rotation"]["angle"]
            turn = np.exp(-1j * angle) * (x + 1j * y)
            x = turn.real + laws.inexact(hidden, "stage_rotation") * angle * y
            y = turn.imag
        if "stage_scale" in hidden:
            stretch = hidden["stage_scale"]
            skew = laws.inexact(hidden, "stage_scale") * np.hypot(
                stretch["stretch_x"], stretch["stretch_y"]
            )
            x = x * (1 + stretch["stretch_x"]) + skew * y
            y = y * (1 + stretch["stretch_y"])
        if "finite_spot" in hidden:
            sd = hidden["finite_spot"]["radius"] / 2
            much = laws.inexact(hidden, "finite_spot")
            weight = np.exp(-(self.spot**2) / 2)
            total = weight.sum() ** 2
            values = sum(
                a
                * b
                / total
                * self._read(x + sd * (1 + much) * dx, y + sd * (1 - much) * dy, base, hidden)
                for a, dx in zip(weight, self.spot, strict=True)
                for b, dy in zip(weight, self.spot, strict=True)
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
            much = laws.inexact(hidden, "trigger_jitter")
            late_by = omega * hidden["trigger_jitter"]["sd"]
            values = values * laws.late(np.asarray(order * late_by, np.float64), much)
        if "detector_bandwidth" in hidden:
            constant = hidden["detector_bandwidth"]["time_constant"]
            answer = low_passed(ORDERS + 1, self.drive, constant)[1:, None, None]
            # The phase of the motion counts from behind the delay that all harmonics share
            values = values * answer * np.exp(1j * order * omega * constant)
            more = laws.inexact(hidden, "detector_bandwidth") * constant
            if more:
                answer = low_passed(ORDERS + 1, self.drive, more)[1:, None, None]
                values = values * answer * np.exp(1j * order * omega * more)
        if "crosstalk" in hidden and self.driven is not None:
            leak = hidden["crosstalk"]["real"] + 1j * hidden["crosstalk"]["imag"]
            place = self.axis / self.axis.max()
            uneven = 1 + laws.inexact(hidden, "crosstalk") * np.add.outer(place, place**2)
            values = values + (order == 1) * self.driven * leak * uneven
        film = _film(self.name)
        return np.asarray(
            np.where(film.over_hole(x, y), np.nan, values) if isinstance(film, Drum) else values
        )

    def _read(
        self, x: Array, y: Array, base: Values, hidden: dict[str, Values]
    ) -> NDArray[np.complex128]:
        """Harmonics at points of the film, for a motion whose phase is zero."""
        shapes = _shapes(self.name, x.tobytes(), y.tobytes()).reshape(MODES, *x.shape)
        shape = shapes[0]
        rest = np.zeros(x.shape)  # how far the film stands off [m]
        if "phase_tilt" in hidden:
            tilt = hidden["phase_tilt"]
            rest = rest + tilt["slope_x"] * x + tilt["slope_y"] * y
            # A curved gap would be a bow, which is another cause
            twist = laws.inexact(hidden, "phase_tilt") * np.hypot(tilt["slope_x"], tilt["slope_y"])
            rest = rest + 2 * twist * x * y / self.axis.max()
        if "static_bow" in hidden:
            rest = rest + hidden["static_bow"]["depth"] * shape * (
                1 + laws.inexact(hidden, "static_bow") * (1 - shape)
            )
        tau = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
        swing = np.ones(x.shape, complex)
        if "resonance_drift" in hidden:
            swing = drifting(x.size, **hidden["resonance_drift"]).reshape(x.shape)
        late = np.zeros(x.shape)
        for k in range(1, 5):
            if "mode_admixture" in hidden:
                shape = shape + hidden["mode_admixture"][f"e{k}"] * shapes[k]
                late = late + hidden["mode_admixture"][f"q{k}"] * shapes[k]
                more = laws.inexact(hidden, "mode_admixture") * hidden["mode_admixture"][f"e{k}"]
                shape = shape + more * shapes[k + 5]
        if "doublet" in hidden:
            pair = hidden["doublet"]
            partner = shapes[round(pair["partner"])]
            third = shapes[round(pair["partner"]) % 5 + 6]
            partner = partner + laws.inexact(hidden, "doublet") * third
            shape = shape + pair["in_phase"] * partner
            late = late + pair["quadrature"] * partner
        moving = base["amplitude"] * swing * (shape + 1j * late)
        u = moving.real[..., None] * np.cos(tau) - moving.imag[..., None] * np.sin(tau)
        u = u + rest[..., None]
        if "quadratic_stiffness" in hidden:
            orbit = base["amplitude"] * bent(
                hidden["quadratic_stiffness"]["kappa2"] * base["amplitude"], SAMPLES
            )
            series = np.fft.rfft(orbit - base["amplitude"] * np.cos(tau)) / SAMPLES
            more = series[0].real * np.abs(swing[..., None]) ** 2
            for n in range(2, ORDERS):
                more = more + 2 * (swing[..., None] ** n * series[n] * np.exp(1j * n * tau)).real
            other = 1 + laws.inexact(hidden, "quadratic_stiffness") * (1 - shapes[0])
            u = u + (shapes[0] * other)[..., None] * more
        if "mechanical_overtones" in hidden:
            sung = hidden["mechanical_overtones"]
            for n in (2, 3):
                k = int(np.argmin(np.abs(self.frequencies - n * self.frequencies[0])))
                size = (swing[..., None] / np.abs(swing).max()) ** n
                mixed = shapes[k] + laws.inexact(hidden, "mechanical_overtones") * shapes[k - 1]
                size = size * (sung[f"cos{n}"] - 1j * sung[f"sin{n}"]) * mixed[..., None]
                u = u + (size * np.exp(1j * n * tau)).real
        v = self._clipped(self._lit(u, base, hidden), base, hidden)
        return np.asarray(
            2 / SAMPLES * np.moveaxis(np.fft.fft(v, axis=-1)[..., 1 : ORDERS + 1], -1, 0)
        )

    def _clipped(self, v: Array, base: Values, hidden: dict[str, Values]) -> Array:
        """The signal between the rails of the detector."""
        largest_signal = base["contrast"] * self._top(hidden)
        if "detector_saturation" in hidden:
            limit = largest_signal * (1 - hidden["detector_saturation"]["clipped"])
            v = laws.rounded(v, limit, -1.0, laws.inexact(hidden, "detector_saturation"))
        if "one_sided_saturation" in hidden:
            left = 1 - hidden["one_sided_saturation"]["clipped"]
            much = laws.inexact(hidden, "one_sided_saturation")
            v = laws.rounded(v, largest_signal * left, -np.inf, much)
        return v

    def _top(self, hidden: dict[str, Values]) -> float:
        """Largest value of the fringe, in units of its contrast."""
        return (
            largest(self.stack, laws.first(hidden["multilayer_fringe"]), self.wavelength)
            if "multilayer_fringe" in hidden and self.stack is not None
            else 1.0
        )

    def _lit(self, u: Array, base: Values, hidden: dict[str, Values]) -> Array:
        if "multilayer_fringe" not in hidden or self.stack is None:
            return np.asarray(
                base["contrast"] * np.cos(4 * np.pi / self.wavelength * u + base["theta"])
            )
        light = hidden["multilayer_fringe"]
        values = laws.first(light)
        read = fringe(self.stack, values, self.wavelength)(light["gap"] + u)
        weak = laws.inexact(hidden, "multilayer_fringe")
        if weak:
            second = fringe(self.stack, values, laws.SECOND_LINE * self.wavelength)
            read = read + weak * second(light["gap"] + u)
        return np.asarray(base["contrast"] * read)


def setup(name: str, causes: tuple[str, ...], rng: np.random.Generator) -> MapBench:
    """Prepare a measurement."""
    return MapBench(name, causes, rng)


def _stack(rng: np.random.Generator, bench: MapBench) -> Cause:
    gap = bench.gap + float(rng.uniform(-1, 1)) * WAVELENGTH / 4
    return Cause({"gap": gap} | film_and_beam(rng, bench.thickness), ())


def film_and_beam(rng: np.random.Generator, thickness: float) -> Values:
    """Draw a film within a few per cent of the file's, and a waist of 2 to 20 µm."""
    waist = float(np.exp(rng.uniform(*np.log([2e-6, 20e-6]))))
    return {
        "thickness": thickness * float(rng.uniform(0.97, 1.03)),
        "index_scale": float(rng.uniform(0.98, 1.04)),
        "aperture_square": (WAVELENGTH / (np.pi * waist)) ** 2,
    }


def _doublet(rng: np.random.Generator, bench: MapBench) -> Cause:
    turn = float(rng.uniform(-np.pi, np.pi))
    values = {"in_phase": 1e-3 * np.cos(turn), "quadrature": 1e-3 * np.sin(turn)}
    partner = {"partner": float(rng.integers(1, 6))}
    return Cause(values | partner, ("in_phase", "quadrature"), 500.0)


def _drift(rng: np.random.Generator, bench: MapBench) -> Cause:
    values = {
        "detuning": float(rng.uniform(-1, 1)),
        "drift": 1e-3 * sign(rng),
        "linewidth": float(np.exp(rng.uniform(*np.log([30, 300])))),
    }
    return Cause(values, ("drift",), 3e3)


def _leak(rng: np.random.Generator, bench: MapBench) -> Cause:
    turn = rng.uniform(-np.pi, np.pi)
    return Cause(
        {"real": 1e-5 * float(np.cos(turn)), "imag": 1e-5 * float(np.sin(turn))},
        ("real", "imag"),
        1e3,
    )


CAUSES: dict[str, Callable[[np.random.Generator, MapBench], Cause]] = {
    "crosstalk": _leak,
    "detector_bandwidth": one("time_constant", 3e-9, 20.0),
    "detector_saturation": one("clipped", 0.05, 10.0),
    "one_sided_saturation": one("clipped", 0.05, 10.0),
    "doublet": _doublet,
    "finite_spot": one("radius", 2e-6, 5.0),
    "mechanical_overtones": vector(("cos2", "sin2", "cos3", "sin3"), 1e-9, 60.0),
    "mode_admixture": vector(("e1", "e2", "e3", "e4", "q1", "q2", "q3", "q4"), 1e-3, 150.0),
    "multilayer_fringe": _stack,
    "phase_tilt": vector(("slope_x", "slope_y"), 10.0 * WAVELENGTH / (4 * np.pi), 1000.0),
    "quadratic_stiffness": lambda rng, bench: Cause({"kappa2": 3e3 * sign(rng)}, ("kappa2",), 60.0),
    "resonance_drift": _drift,
    "stage_rotation": lambda rng, bench: Cause({"angle": 1e-3 * sign(rng)}, ("angle",), 200.0),
    "stage_scale": vector(("stretch_x", "stretch_y"), 1e-3, 100.0),
    "static_bow": lambda rng, bench: Cause(
        {"depth": 1e-2 * WAVELENGTH / (4 * np.pi) * sign(rng)}, ("depth",), 200.0
    ),
    "trigger_jitter": one("sd", 3e-9, 25.0),
}
DERIVED: dict[str, str] = {
    "crosstalk": "added to the Fourier coefficients of the sampled signal",
    "detector_bandwidth": "a recursive low pass run in time until it is steady",
    "detector_saturation": "the sampled signal is clipped in time",
    "one_sided_saturation": "the sampled signal is clipped above in time",
    "doublet": "in-phase and quadrature motion in time, whose fringe goes through an FFT",
    "finite_spot": "quadrature of the signal over the points of the spot, instead of diffusion",
    "mechanical_overtones": "added to the sampled motion, whose fringe goes through an FFT",
    "mode_admixture": "in-phase and quadrature motion in time, whose fringe goes through an FFT",
    "multilayer_fringe": "Fresnel reflections layer by layer at 32 angles and two polarisations, "
    "tabulated in the gap, instead of a geometric series of overtones",
    "phase_tilt": "a plane distance that is added to the motion before the fringe is read",
    "quadratic_stiffness": "one period of the free oscillation by Runge–Kutta steps",
    "resonance_drift": "slow equation of motion in time along the scan, not its steady state",
    "stage_rotation": "places turned as complex numbers, shapes of the laboratory's own film",
    "stage_scale": "places stretched, shapes of the laboratory's own film",
    "static_bow": "a distance that is added to the motion before the fringe is read",
    "trigger_jitter": "Gauss–Hermite average over late triggers, instead of its closed form",
}
"""How the laboratory computes each cause, where the library does otherwise."""
