"""Up and down sweeps of one mode, by time steps of its slow flow and that of a mode it drives.

A restoring force of second order enters through the frequency of the free oscillation, from the
energy between its turning points.
"""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numba
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from femnl.device import geometry
from femnl.io import measurement
from femnl.observe.film import SimulatedFilm
from tests.blind.lab.bench import Array, Cause, Values, sign

ALPHA_SD = 0.2
"""Relative standard deviation of α from film to film, through Young's modulus."""
NARROWEST = 0.05
"""Part of the linewidth below which it is not followed where base parameters move along their
tangents, which know no zero.
"""
STEPS = 40_000
STRIDE = 0.05
SETTLED = 1e-6
"""Most Runge–Kutta steps at each point of a sweep, in units of the amplitude's decay time, and the
change in a step that ends them.

Just past a fold a state lingers: a point that were taken there would be on no branch.
"""
WAVELENGTH = 632.8e-9
COARSE = 1e3
TORN = 2.0
"""How much longer steps for tangents are than of closed forms, and the ratio of amplitudes of a
point that has jumped.
"""
IMPLICIT = 3
"""Rounds in which an implicit step is found."""
CLIPPED = 2 * np.pi * (np.arange(720) + 0.5) / 720
"""Phases at which a clipped signal is sampled."""
Complex = NDArray[np.complex128]
FIRST = 2 * np.pi * np.arange(64) / 64
"""Phases at which the signal of the fringe is sampled."""


class ResponseBench:
    """Eight sweeps; see `Bench`."""

    def __init__(self, name: str, causes: tuple[str, ...], rng: np.random.Generator) -> None:
        timed = "frequency_drift" in causes
        self.soft = "quadratic_stiffness" in causes
        self.mode, self.f0 = ("2,2", 2.9324e6) if rng.uniform() < 0.5 else ("1,1", 1.4661e6)
        film = SimulatedFilm(geometry.load(name), 12)
        self.alpha = float(film.alpha[film.modes.label.index(f"({self.mode})")])
        self.drives = np.repeat(np.array([0.05, 0.1, 0.2, 0.4]), 2)
        self.direction = np.tile([1, -1], 4)
        self.time = 120.0 * np.arange(8) if timed or rng.uniform() < 0.5 else None
        self.noise = 1.5e-5
        self.points = 81
        linewidth = self.linewidth = rng.uniform(3, 5)
        # Linewidths by which the strongest drive would move the resonance at full amplitude
        stretch = rng.uniform(3, 14)
        self.peak = float(
            np.sqrt(stretch * linewidth / (0.375 * self.f0 * self.alpha)) / self.drives.max()
        )
        self.gain = 0.014 / (self.peak * 0.4)
        worth = {
            "frequency": linewidth,
            "linewidth": linewidth,
            "peak": self.peak,
            "gain": self.gain,
            "phase": 1.0,
        }
        self.unit = {name: COARSE * value for name, value in worth.items()}
        reach = 0.375 * self.f0 * self.alpha * (self.peak * self.drives.max()) ** 2
        self.reach = 0.8 * reach
        low, high = (self.reach, 0.0) if self.soft else (0.0, self.reach)
        self.frequency = np.linspace(
            self.f0 - 8 * linewidth - low, self.f0 + 8 * linewidth + high, self.points
        )

    def draw(self, rng: np.random.Generator) -> Values:
        """Draw f₀, w [Hz], the linear peak [m/V], the gain [V/m], its phase, and α [m⁻²]."""
        return {
            "frequency": self.f0 + rng.uniform(-2, 2),
            "linewidth": self.linewidth * rng.uniform(0.9, 1.1),
            "peak": self.peak * rng.uniform(0.95, 1.05),
            "gain": self.gain,
            "phase": rng.uniform(-np.pi, np.pi),
            "alpha": self.alpha * max(1 + ALPHA_SD * rng.standard_normal(), 0.4),
        }

    def clean(self, variants: list[tuple[Values, dict[str, Values]]]) -> Array:
        """Both quadratures over their σ; all variants are stepped side by side."""
        bases = [base for base, _ in variants]
        volts = self._swept(bases, [hidden for _, hidden in variants]) / self.noise
        size = np.abs(volts)
        # A point that jumps in some of them has no tangents
        volts *= size.max(axis=0) < TORN * size.min(axis=0)
        flat = volts.reshape(len(variants), -1)
        return np.concatenate([flat.real, flat.imag], axis=1)

    def _swept(self, bases: list[Values], hidden: list[dict[str, Values]]) -> Complex:
        def spec(cause: str, name: str) -> Array:
            return np.array([h.get(cause, {}).get(name, 0.0) for h in hidden])[:, None]

        f0, w, peak, alpha = (
            np.array([b[name] for b in bases])[:, None]
            for name in ("frequency", "linewidth", "peak", "alpha")
        )
        w = np.maximum(w, self.linewidth * NARROWEST)
        if self.time is not None:
            f0 = f0 * (1 + spec("frequency_drift", "rate") * self.time)
        drive = peak * self.drives / (1 + spec("drive_compression", "kappa") * self.drives**2) + 0j
        alpha = (
            alpha
            + np.array(
                [_softening(b, h, self.drives.max()) for b, h in zip(bases, hidden, strict=True)]
            )[:, None]
        )
        cubic = 0.75 * f0 / w * alpha
        quintic = 0.625 * f0 / w * spec("quintic_stiffness", "alpha5")
        loss = spec("nonlinear_damping", "eta") / 4
        order = np.array([round(h.get("internal_resonance", {}).get("order", 2)) for h in hidden])[
            :, None
        ]
        # Coupled as q₁ᵖq₂ to a mode at f_j, which moves at p times the drive; metres of it are
        # free, so that both feel one coupling.
        stiffening = 8 * w / (3 * f0 * np.abs(alpha))
        coupling = (
            2
            / w
            * np.sqrt(
                order * spec("internal_resonance", "coupling_square") / stiffening ** (order - 1)
            )
        )
        crossing = self.frequency[[0, -1]].mean() + spec("internal_resonance", "offset")
        leaves = order / 2 * spec("internal_resonance", "width") * 2 / w
        state = np.zeros(drive.size, complex)
        other = np.zeros(drive.size, complex)
        motion = np.empty((len(bases), 8, self.points), complex)
        for k in range(self.points):
            point = np.where(self.direction > 0, k, self.points - 1 - k)
            detuning = 2 * (f0 - self.frequency[point]) / w
            turn = order * 2 * (crossing - self.frequency[point]) / w + 1j * leaves
            whole = np.broadcast_arrays(
                detuning, cubic, quintic, loss, drive, turn, coupling, order
            )
            _compiled()(
                state, other, bool(np.any(coupling)), _Flow(*(part.ravel() for part in whole))
            )
            motion[:, np.arange(8), point] = state.reshape(drive.shape)
        z = (
            4
            * np.pi
            / WAVELENGTH
            * np.sqrt(np.maximum(spec("nonlinear_readout", "share"), 1e-12))[..., None]
            * np.abs(motion)
        )
        first = (
            2
            * np.mean(np.sin(z[..., None] * np.cos(FIRST)) * np.cos(FIRST), axis=-1)
            / np.maximum(z, 1e-300)
        )
        gain = np.array([b["gain"] * np.exp(1j * b["phase"]) for b in bases])[:, None, None]
        leak = (spec("crosstalk", "real") + 1j * spec("crosstalk", "imag"))[..., None]
        volts = (
            gain * motion * np.where(z > 1e-3, first, 1 - z**2 / 8) + leak * self.drives[:, None]
        )
        for k, h in enumerate(hidden):
            if "detector_saturation" in h:
                limit = (1 - h["detector_saturation"]["part"]) * np.abs(volts[k]).max()
                strong = np.abs(volts[k]) > limit
                size = np.abs(volts[k][strong])
                clipped = np.clip(size[:, None] * np.cos(CLIPPED), -limit, limit)
                volts[k][strong] *= 2 * np.mean(clipped * np.cos(CLIPPED), axis=1) / size
        return np.asarray(volts)

    def measured(
        self, base: Values, hidden: dict[str, Values], rng: np.random.Generator
    ) -> dict[str, xr.Dataset]:
        """Quadratures with noise, to a tenth of a microvolt."""
        volts = self._swept([base], [hidden])[0]
        noise = rng.standard_normal((2, *volts.shape))
        noisy = np.round(volts + self.noise * (noise[0] + 1j * noise[1]), 7)
        about = {"noise_sd": self.noise, "wavelength": WAVELENGTH}
        return {
            "response": measurement.response(
                self.frequency,
                noisy,
                mode=self.mode,
                drive=self.drives,
                direction=self.direction,
                x=6e-5,
                y=6e-5,
                time=self.time,
                **about,
            )
        }


def _softening(base: Values, hidden: dict[str, Values], drive: float) -> float:
    """What a restoring force of second order adds to α.

    8/3 of the shift of the free oscillation of k = 1, u + κ₂u², over A².
    """
    kappa = hidden.get("quadratic_stiffness", {}).get("kappa2", 0.0) * base["peak"] * drive
    if kappa == 0:
        return 0.0
    shift = []
    for size in (1.0, -1.0):  # from either turning point: what is odd in the amplitude drops out
        ends = np.roots([kappa / 3 * size, 0.5, 0.0, -(0.5 + kappa / 3 * size)])
        low = float(ends[np.argmin(np.abs(ends + 1))].real)
        psi = np.pi * (np.arange(64) + 0.5) / 64
        u = (1 + low) / 2 + (1 - low) / 2 * np.cos(psi)
        # (1 − u)(u − low) is a factor of the energy that is left, and cancels against that of the
        # substitution.
        rest = 0.5 + kappa / 3 * size * (u + 1 + low)
        shift.append(1 / np.mean(1 / np.sqrt(2 * rest)) - 1)
    return float(8 / 3 * np.mean(shift) / (base["peak"] * drive) ** 2)


@cache
def _compiled() -> Callable[..., None]:
    """Return `_settle` as machine code."""
    return numba.njit(error_model="numpy")(_settle)


class _Flow(NamedTuple):
    """The slow flow of each point, (n,): see `_settle`."""

    delta: Array
    cubic: Array
    quintic: Array
    loss: Array
    drive: Complex
    turn: Complex
    coupling: Array
    power: NDArray[np.int64]


def _settle(a: Complex, b: Complex, coupled: bool, flow: _Flow) -> None:
    """Step every a (n,) in time until none changes any more.

    da/ds = −i (drive − a (δ + cubic|a|² + quintic|a|⁴ + i (1 + loss|a|²))).

    By Runge–Kutta steps; coupled to a mode b at p times the drive, db/ds = i (b turn + g aᵖ), and +
    i g a*^{p−1} b in da/ds, by the implicit midpoint rule, which keeps the fast turning of that
    mode stable. The amplitude of b counts so that its own g is the same.
    """
    delta, cubic, quintic, loss, drive, turn, coupling, power = flow
    h = STRIDE
    largest = np.abs(drive).max()
    for n in range(STEPS):
        change = 0.0
        for i in range(len(a)):
            before = a[i]
            if coupled:
                last = before
                other = b[i]
                for _ in range(IMPLICIT):
                    middle = (before + last) / 2
                    x = middle.real**2 + middle.imag**2
                    lower = coupling[i] * (middle if power[i] == 2 else middle * middle)
                    own = (
                        0.5j
                        * h
                        * (delta[i] + x * (cubic[i] + quintic[i] * x) + 1j * (1 + loss[i] * x))
                    )
                    last = (
                        before * (1 + own)
                        - 1j * h * (drive[i] - np.conj(lower) * (b[i] + other) / 2)
                    ) / (1 - own)
                    other = (b[i] * (1 + 0.5j * h * turn[i]) + 1j * h * lower * middle) / (
                        1 - 0.5j * h * turn[i]
                    )
                a[i] = last
                b[i] = other
            else:
                rate = 0j
                total = 0j
                for stage in range(4):
                    here = before + (0.0 if stage == 0 else h if stage == 3 else h / 2) * rate
                    x = here.real**2 + here.imag**2
                    rate = -1j * (
                        drive[i]
                        - here
                        * (delta[i] + x * (cubic[i] + quintic[i] * x) + 1j * (1 + loss[i] * x))
                    )
                    total += rate if stage in (0, 3) else 2 * rate
                a[i] = before + h / 6 * total
            if n % 10 == 9:
                change = max(change, abs(a[i] - before))
        if n % 10 == 9 and change < SETTLED * largest:
            return


def setup(name: str, causes: tuple[str, ...], rng: np.random.Generator) -> ResponseBench:
    """Prepare a measurement."""
    return ResponseBench(name, causes, rng)


def _strongest(bench: ResponseBench) -> float:
    return bench.peak * 0.4


def _leak(rng: np.random.Generator, bench: ResponseBench) -> Cause:
    turn = rng.uniform(-np.pi, np.pi)
    slope = 1e-3 * bench.gain * bench.peak
    return Cause(
        {"real": float(slope * np.cos(turn)), "imag": float(slope * np.sin(turn))},
        ("real", "imag"),
        300.0,
    )


def _damping(rng: np.random.Generator, bench: ResponseBench) -> Cause:
    return Cause({"eta": 1e-2 / _strongest(bench) ** 2}, ("eta",), 1e3)


def _quintic(rng: np.random.Generator, bench: ResponseBench) -> Cause:
    # The quintic term stays a small part of the cubic one.
    return Cause(
        {"alpha5": sign(rng) * 1e-3 * bench.alpha / _strongest(bench) ** 2}, ("alpha5",), 50.0
    )


def _second_mode(rng: np.random.Generator, bench: ResponseBench) -> Cause:
    # Where the stronger sweeps pass it, at a multiple of the drive.
    crossing = bench.f0 + float(rng.uniform(0.0, 0.6)) * (
        -bench.reach if bench.soft else bench.reach
    )
    values = {
        "coupling_square": 1e-2 * bench.linewidth**2,
        "offset": crossing - float(bench.frequency[[0, -1]].mean()),
        "width": bench.linewidth * float(np.exp(rng.uniform(np.log(0.2), np.log(3.0)))),
        "order": float(rng.choice([2.0, 3.0])),
    }
    return Cause(values, ("coupling_square",), 300.0)


def _bow(rng: np.random.Generator, bench: ResponseBench) -> Cause:
    # Sweeps show it only where it makes them soften.
    return Cause(
        {"kappa2": float(sign(rng) * np.sqrt(0.9 * bench.alpha * (1 + rng.uniform(0.9, 1.6))))}, ()
    )


def _readout(rng: np.random.Generator, bench: ResponseBench) -> Cause:
    z = 4 * np.pi / WAVELENGTH * _strongest(bench)
    return Cause({"share": 0.1 / z**2}, ("share",), 30.0)


CAUSES: dict[str, Callable[[np.random.Generator, ResponseBench], Cause]] = {
    "crosstalk": _leak,
    "detector_saturation": lambda rng, bench: Cause({"part": 0.02}, ("part",), 25.0),
    "drive_compression": lambda rng, bench: Cause({"kappa": 0.05}, ("kappa",), 100.0),
    "frequency_drift": lambda rng, bench: Cause({"rate": 1e-10 * sign(rng)}, ("rate",), 1e3),
    "internal_resonance": _second_mode,
    "nonlinear_damping": _damping,
    "nonlinear_readout": _readout,
    "quadratic_stiffness": _bow,
    "quintic_stiffness": _quintic,
}
