"""Up and down sweeps of one mode, by time steps of its slow flow and that of a mode it drives.

A restoring force of second order enters through the frequency of the free oscillation, from the
energy between its turning points.
"""

from collections.abc import Callable

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from femnl.core.device import Model
from femnl.device import geometry
from femnl.io import measurement
from tests.blind.lab import laws, swept
from tests.blind.lab.bench import INEXACT, Array, Cause, Noise, Values, sign
from tests.blind.lab.maps import _shapes
from tests.blind.lab.response_forms import DERIVED
from tests.blind.lab.slow_flow import Flow, compiled, softening

ALPHA_SD = 0.2
"""Relative standard deviation of α from film to film, through Young's modulus."""
NARROWEST = 0.05
"""Part of the linewidth below which it is not followed where base parameters move along their
tangents, which know no zero.
"""
WAVELENGTH = 632.8e-9
COARSE = 1e3
TORN = 2.0
"""How much longer steps for tangents are than of closed forms, and the ratio of amplitudes of a
point that has jumped.
"""
Complex = NDArray[np.complex128]
NARROW = 0.1
WIDE = 1e3
"""Linewidths of devices [Hz]: of soft-clamped modes in vacuum, and of low modes that a chip damps.
"""
DELAYED = 100.0
"""Linewidth from which on the delay of an instrument shows in sweeps."""
PLACES = ((6e-5, 6e-5), (4e-5, 7e-5))
"""Of the laser, in m."""
RAILS = {"detector_saturation": -1.0, "one_sided_saturation": -np.inf}
"""Causes that clip, and the lower rail in units of the upper one."""
CUBIC = {"1,1": 10.405, "2,2": 169.2}
"""k₃ in Eh/((1 − ν²)L²) of a square with clamped edges, by Legendre polynomials."""
MODES = {"1,1": 0, "2,2": 3}
"""Their number in the order of frequency."""


def _alpha(model: Model, mode: str) -> float:
    """Return k₃/k of an ideal square membrane, k = ¼π²(m² + n²)σh."""
    film = model.film
    m, n = map(int, mode.split(","))
    energy = CUBIC[mode] / (1 - film.poisson**2) * film.young / model.outline.length**2
    return float(4 * energy / film.stress / (np.pi**2 * (m * m + n * n)))


class ResponseBench:
    """Eight sweeps; see `Bench`."""

    def __init__(self, name: str, causes: tuple[str, ...], rng: np.random.Generator) -> None:
        timed = "frequency_drift" in causes
        self.soft = "quadratic_stiffness" in causes
        self.mode, self.f0 = ("2,2", 2.9324e6) if rng.uniform() < 0.5 else ("1,1", 1.4661e6)
        self.alpha = _alpha(geometry.load(name), self.mode)
        self.places = PLACES[: int(rng.integers(1, 3))]
        count = 8 * len(self.places)
        self.drives = np.tile(np.repeat(np.array([0.05, 0.1, 0.2, 0.4]), 2), len(self.places))
        self.direction = np.tile([1, -1], count // 2)
        self.place = np.repeat(np.arange(len(self.places)), 8)
        x, y = np.array(self.places).T
        self.shape = np.abs(_shapes(name, x.tobytes(), y.tobytes())[MODES[self.mode]])[self.place]
        self.time = 120.0 * np.arange(count) if timed or rng.uniform() < 0.5 else None
        # Sweeps without a duration follow each other without a pause
        self.duration = float(rng.choice([60.0, 120.0]))
        self.noise = 1.5e-5
        self.points = 81
        least = DELAYED if "group_delay" in causes else NARROW
        linewidth = self.linewidth = float(np.exp(rng.uniform(np.log(least), np.log(WIDE))))
        # Linewidths by which the strongest drive would move the resonance at full amplitude; what
        # does not settle has no steady state to jump between
        stretch = rng.uniform(0.1, 0.7) if "unsettled_mode" in causes else rng.uniform(3, 14)
        self.peak = float(
            np.sqrt(stretch * linewidth / (0.375 * self.f0 * self.alpha)) / self.drives.max()
        )
        self.gain = 0.014 / (self.peak * 0.4)
        worth = {
            "frequency": linewidth,
            "linewidth": linewidth,
            "peak": self.peak,
            **{f"gain{p}": self.gain for p in range(len(self.places))},
            **{f"phase{p}": 1.0 for p in range(len(self.places))},
        }
        self.unit = {name: COARSE * value for name, value in worth.items()}
        reach = 0.375 * self.f0 * self.alpha * (self.peak * self.drives.max()) ** 2
        self.reach = 0.8 * reach
        low, high = (self.reach, 0.0) if self.soft else (0.0, self.reach)
        self.frequency = np.linspace(
            self.f0 - 8 * linewidth - low, self.f0 + 8 * linewidth + high, self.points
        )

    def draw(self, rng: np.random.Generator) -> Values:
        """Draw f₀, w [Hz], the linear peak [m/V], gains [V/m], their phases, and α [m⁻²]."""
        return {
            "frequency": self.f0 + rng.uniform(-0.5, 0.5) * self.linewidth,
            "linewidth": self.linewidth * rng.uniform(0.9, 1.1),
            "peak": self.peak * rng.uniform(0.95, 1.05),
            **{f"gain{p}": self.gain / (1 + p) for p in range(len(self.places))},
            **{f"phase{p}": rng.uniform(-np.pi, np.pi) for p in range(len(self.places))},
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
        rate = spec("frequency_drift", "rate")
        drive = peak * self.drives / (1 + spec("drive_compression", "kappa") * self.drives**2) + 0j
        drive = drive * laws.saturating(
            self.drives, spec("drive_compression", "kappa"), spec("drive_compression", INEXACT)
        )
        softer = np.array(
            [softening(b, h, self.drives.max()) for b, h in zip(bases, hidden, strict=True)]
        )[:, None]
        alpha = alpha + softer
        swing = (peak * self.drives.max()) ** 2
        cubic = 0.75 * f0 / w * alpha
        quintic = 0.625 * f0 / w * spec("quintic_stiffness", "alpha5")
        septic = quintic * spec("quintic_stiffness", INEXACT) / swing
        quintic = quintic + cubic * softer / alpha * spec("quadratic_stiffness", INEXACT) / swing
        loss = spec("nonlinear_damping", "eta") / 4
        more_loss = loss * spec("nonlinear_damping", INEXACT) / swing
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
        detuned = (self.drives / self.drives.max()) ** 2 * self.linewidth
        crossing = crossing + spec("internal_resonance", INEXACT) * detuned
        leaves = order / 2 * spec("internal_resonance", "width") * 2 / w
        state = np.zeros(drive.size, complex)
        other = np.zeros(drive.size, complex)
        motion = np.empty((len(bases), len(self.drives), self.points), complex)
        left = spec("unsettled_mode", "kept")
        rest = np.where(left > 0, -np.log(np.where(left > 0, left, 1.0)), np.inf)
        for k in range(self.points):
            point = np.where(self.direction > 0, k, self.points - 1 - k)
            time: Array | float = 0.0
            if self.time is not None:
                time = np.asarray(self.time + self.duration * (k + 0.5) / self.points, np.float64)
                whole = float(self.time.max()) + self.duration
                time = laws.relaxed(time, whole, spec("frequency_drift", INEXACT))
            driven = self.frequency[point]
            own = f0 * (1 + rate * time)
            # (f₀² − f² + i f w) A is the whole balance of a linear mode, and f w is taken out of it
            detuning = (own**2 - driven**2) / (driven * w)
            ratio = own / driven
            turn = order * 2 * (crossing - driven) / w + 1j * leaves
            uneven = 1 + spec("unsettled_mode", INEXACT) * np.sin(4 * np.pi * k / self.points)
            flow = np.broadcast_arrays(
                detuning,
                cubic * ratio,
                quintic * ratio,
                loss,
                drive * ratio,
                turn,
                coupling * np.sqrt(ratio),
                order,
                # The first point is taken once the mode has settled.
                rest * uneven if k else np.inf,
                septic * ratio,
                more_loss,
            )
            compiled()(state, other, bool(np.any(coupling)), Flow(*(part.ravel() for part in flow)))
            motion[:, np.arange(len(self.drives)), point] = state.reshape(drive.shape)
        return self._read_out(motion, bases, hidden)

    def _read_out(
        self, motion: Complex, bases: list[Values], hidden: list[dict[str, Values]]
    ) -> Complex:
        """Return the voltages (n_variants, n_sweeps, n_points) [V] of motion of that shape [m]."""
        found = []
        off = self.frequency - self.f0
        for moved, base, causes in zip(motion, bases, hidden, strict=True):
            gain = np.array(
                [base[f"gain{p}"] * np.exp(1j * base[f"phase{p}"]) for p in range(len(self.places))]
            )[self.place]
            if "nonlinear_readout" in causes:
                share = np.sqrt(max(causes["nonlinear_readout"]["share"], 1e-12))
                size = share * self.shape[:, None] * np.abs(moved)
                z = 4 * np.pi / WAVELENGTH * size
                much = laws.inexact(causes, "nonlinear_readout")
                moved = (1 - much) * swept.fringe(moved, z) + much * moved / (1 + z**2 / 8)
            volts = gain[:, None] * moved
            for name in ("crosstalk", "sloping_background", "fano_background"):
                if name in causes:
                    volts = volts + self.drives[:, None] * self._beside(name, causes[name])
            if "group_delay" in causes:
                much = laws.inexact(causes, "group_delay")
                uneven = off * (1 + much * off / np.ptp(off))
                volts = swept.late(volts, uneven, causes["group_delay"]["tau"])
            for name, low in RAILS.items():
                if name in causes:
                    volts = swept.clipped(
                        volts, causes[name]["part"], low, laws.inexact(causes, name)
                    )
            if "lock_in_filter" in causes:
                chain = causes["lock_in_filter"]
                volts = swept.filtered(volts, self.direction, chain)
                if INEXACT in chain:
                    more = {"left": chain[INEXACT] * chain["left"], "poles": 1.0}
                    volts = swept.filtered(volts, self.direction, more)
            found.append(volts)
        return np.asarray(found)

    def _beside(self, name: str, values: Values) -> Complex:
        """Return what is seen beside the mode (n_points,) [V/V]."""
        level = values["real"] + 1j * values["imag"]
        much = values.get(INEXACT, 0.0)
        ripple = laws.rippled(self.frequency, much)
        if name == "crosstalk":
            return np.asarray(level * ripple, complex)
        middle = float(self.frequency[[0, -1]].mean())
        centre = middle + values["place"]
        answer = swept.oscillator(self.frequency, centre, values["broad"])
        if name == "sloping_background":
            # A bridge that compensates the leak in the middle leaves its slope.
            answer = answer - swept.oscillator(np.array([middle]), centre, values["broad"])
            answer = answer * ripple
        elif much:
            beside = centre + 0.7 * values["broad"]
            answer = answer + much * swept.oscillator(self.frequency, beside, values["broad"])
        return np.asarray(level * answer, complex)

    def measured(
        self, base: Values, hidden: dict[str, Values], rng: Noise
    ) -> dict[str, xr.Dataset]:
        """Quadratures with noise, to a tenth of a microvolt."""
        volts = self._swept([base], [hidden])[0]
        noise = rng.standard_normal((2, *volts.shape))
        noisy = np.round(volts + self.noise * (noise[0] + 1j * noise[1]), 7)
        return {
            "response": measurement.response(
                self.frequency,
                noisy,
                mode=self.mode,
                drive=self.drives,
                direction=self.direction,
                x=np.array(self.places)[self.place, 0],
                y=np.array(self.places)[self.place, 1],
                time=self.time,
                duration=None if self.duration == 120.0 else self.duration,
                noise_sd=self.noise,
                wavelength=WAVELENGTH,
            )
        }


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
        "width": bench.linewidth * float(np.exp(rng.uniform(np.log(0.05), np.log(3.0)))),
        "order": float(rng.choice([2.0, 3.0])),
    }
    return Cause(values, ("coupling_square",), 300.0)


def _bow(rng: np.random.Generator, bench: ResponseBench) -> Cause:
    # Sweeps show it only where it makes them soften.
    return Cause(
        {"kappa2": float(sign(rng) * np.sqrt(0.9 * bench.alpha * (1 + rng.uniform(0.9, 1.6))))}, ()
    )


def _readout(rng: np.random.Generator, bench: ResponseBench) -> Cause:
    z = 4 * np.pi / WAVELENGTH * _strongest(bench) * float(bench.shape.max())
    return Cause({"share": min(0.1 / z**2, 1.0)}, ("share",), max(10 * z**2, 1.0))


def _drift(rng: np.random.Generator, bench: ResponseBench) -> Cause:
    # A hundredth of a linewidth over all sweeps; the most, as of a chip that warms, and over the
    # span of the sweeps: a mode that has left them shows nothing
    rate = 1e-2 * bench.linewidth / (bench.f0 * 960.0)
    out = float(np.ptp(bench.frequency)) / (bench.f0 * 960.0)
    return Cause({"rate": rate * sign(rng)}, ("rate",), min(8e-7, out) / rate)


def _delay(rng: np.random.Generator, bench: ResponseBench) -> Cause:
    return Cause({"tau": 1e-6 * sign(rng)}, ("tau",), 80.0)


def _piezo(rng: np.random.Generator, bench: ResponseBench) -> Cause:
    span = float(np.ptp(bench.frequency))
    turn = rng.uniform(-np.pi, np.pi)
    slope = 1e-3 * bench.gain * bench.peak
    values = {
        "real": float(slope * np.cos(turn)),
        "imag": float(slope * np.sin(turn)),
        "place": float(rng.uniform(-0.5, 0.5)) * span,
        "broad": float(np.exp(rng.uniform(np.log(0.3), np.log(1.5)))) * span,
    }
    return Cause(values, ("real", "imag"), 300.0)


def _flank(rng: np.random.Generator, bench: ResponseBench) -> Cause:
    span = float(np.ptp(bench.frequency))
    far = 20.0
    turn = rng.uniform(-np.pi, np.pi)
    # At the resonance of the piezo: its flank is w_p/2 over the distance of it.
    slope = 0.1 * bench.gain * bench.peak
    values = {
        "real": float(slope * np.cos(turn)),
        "imag": float(slope * np.sin(turn)),
        "place": far * span * sign(rng),
        "broad": 2 * span,
    }
    return Cause(values, ("real", "imag"), 300.0)


def _filter(rng: np.random.Generator, bench: ResponseBench) -> Cause:
    return Cause({"left": 1e-3, "poles": float(rng.integers(1, 5))}, ("left",), 500.0)


CAUSES: dict[str, Callable[[np.random.Generator, ResponseBench], Cause]] = {
    "crosstalk": _leak,
    "detector_saturation": lambda rng, bench: Cause({"part": 0.02}, ("part",), 25.0),
    "drive_compression": lambda rng, bench: Cause({"kappa": 0.05}, ("kappa",), 100.0),
    "fano_background": _piezo,
    "frequency_drift": _drift,
    "group_delay": _delay,
    "internal_resonance": _second_mode,
    "lock_in_filter": _filter,
    "nonlinear_damping": _damping,
    "nonlinear_readout": _readout,
    "one_sided_saturation": lambda rng, bench: Cause({"part": 0.02}, ("part",), 25.0),
    "quadratic_stiffness": _bow,
    "quintic_stiffness": _quintic,
    "sloping_background": _flank,
    "unsettled_mode": lambda rng, bench: Cause({"kept": 0.01}, ("kept",), 50.0),
}
__all__ = ["CAUSES", "DERIVED", "ResponseBench", "setup"]
