"""A virtual laboratory: measurement files made without the models that a diagnosis fits.

Spectra come from a Ritz expansion in sines, responses from time steps of the slow flow, maps from cubic elements on another mesh, sampled
in time and taken apart by an FFT. Strengths are drawn in the units of the cause, from the seed alone.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.linalg import eigh

from femnl import geometry, measurement, prestress
from femnl.mesh import mesh
from femnl.modes import shape_at, solve_modes
from femnl.types.device import Model

Array = NDArray[np.float64]
GEOMETRY = "square-270um"
WAVELENGTH = 632.8e-9


@dataclass(frozen=True)
class Case:
    """One file: its kind, the causes in it, and the seed that draws everything else."""

    kind: str
    causes: tuple[str, ...]
    seed: int


def make(case: Case, path: Path) -> None:
    """Write the measurement file of a case."""
    rng = np.random.default_rng([case.seed, len(case.kind), *(sum(map(ord, cause)) for cause in case.causes)])
    builder: dict[str, Callable[..., xr.Dataset]] = {"spectrum": spectrum, "response": response, "map": harmonic_map, "series": series}
    dataset = builder[case.kind](case.causes, rng)
    measurement.write(measurement.bundle({case.kind: dataset}, geometry=GEOMETRY), path)


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def spectrum(causes: tuple[str, ...], rng: np.random.Generator, n_modes: int = 12, basis: int = 14, sd: float = 3.0) -> xr.Dataset:
    """Frequencies of a square film, K and M in the basis sin·sin."""
    film, side = geometry.load(GEOMETRY).film, geometry.load(GEOMETRY).outline.length
    orders = np.array([(m, n) for m in range(1, basis + 1) for n in range(1, basis + 1)])
    kx, ky = (np.pi / side * orders[:, a] for a in (0, 1))
    k2 = kx**2 + ky**2
    c2 = film.stress / film.density * (1 + 0.05 * rng.uniform(-1, 1))
    ell = film.thickness * np.sqrt(film.young / (12 * (1 - film.poisson**2) * film.stress)) * (1 + 0.01 * rng.uniform(-1, 1))
    excess = rng.uniform(0.2, 1.0) * 1e-12 if "bending_stiffness" in causes else 0.0
    inner = side - 2 * ell
    stiffness = np.diag(c2 * (k2 * (side / inner) ** 2 + (ell**2 + excess) * k2**2))
    mass = np.eye(len(k2))
    if "stress_anisotropy" in causes:
        a = _sign(rng) * rng.uniform(1e-4, 2e-3)
        stiffness = stiffness + c2 * a / 2 * np.diag(kx**2 - ky**2)
    if "shear_stress" in causes:
        stiffness = stiffness + c2 * rng.uniform(1e-4, 6e-4) * _shear(orders, side)
    if "added_mass" in causes:
        x, y = rng.uniform(0.08, 0.42, 2)
        shape = np.sin(orders[:, 0] * np.pi * (x + 0.5)) * np.sin(orders[:, 1] * np.pi * (y + 0.5))
        mass = mass + 4 * rng.uniform(3e-5, 1e-3) * np.outer(shape, shape)
    if "gas_loading" in causes:
        mass = mass + np.diag(2 * rng.uniform(0.1, 1.2) / (np.sqrt(k2) * film.density * film.thickness))
    values, vectors = eigh(stiffness, mass)
    names = [f"{m},{n}" for m, n in orders[np.argmax(np.abs(vectors[:, :n_modes]), axis=0)]]
    frequency = np.sqrt(values[:n_modes]) / (2 * np.pi)
    for k, name in enumerate(names):  # a pair that is mixed evenly shows one label twice
        if name in names[:k]:
            names[k] = ",".join(reversed(name.split(",")))
    time = 600.0 * rng.permutation(n_modes)
    if "frequency_drift" in causes:
        frequency = frequency * (1 + _sign(rng) * rng.uniform(5e-9, 1e-7) * time)
    timed = time if "frequency_drift" in causes or rng.uniform() < 0.5 else None
    return measurement.spectrum(frequency + sd * rng.standard_normal(n_modes), np.full(n_modes, sd), names, timed)


def _shear(orders: Array, side: float) -> Array:
    """∫ ∂x ξᵢ ∂y ξⱼ + ∂y ξᵢ ∂x ξⱼ over ∫ ξ², in closed form."""

    def along(m: Array, n: Array) -> Array:  # ∫ (sin mx)' sin nx over half the side, zero for equal parity
        difference = np.where((m + n) % 2 == 1, m**2 - n**2, 1)
        return np.where((m + n) % 2 == 1, -4 * m * n / difference, 0.0) / side

    m, n = np.meshgrid(orders[:, 0], orders[:, 0], indexing="ij")
    p, q = np.meshgrid(orders[:, 1], orders[:, 1], indexing="ij")
    return along(m, n) * along(q, p) + along(n, m) * along(p, q)


def response(causes: tuple[str, ...], rng: np.random.Generator) -> xr.Dataset:
    """Up and down sweeps of the mode (2,2), by time steps of its slow flow; metres are those of the published α."""
    f0, w, alpha = 2.9324e6 + rng.uniform(-100, 100), rng.uniform(3, 5), 2.304e10
    per_volt, peak, noise, n = 2e5, 1.75e-7, 1.5e-5, 121
    drives = np.repeat([0.05, 0.1, 0.2, 0.4], 2)
    direction = np.tile([1, -1], 4)
    force = drives.copy()
    strongest = peak * drives.max()
    eta = rng.uniform(0.05, 4) / strongest**2 if "nonlinear_damping" in causes else 0.0
    if "drive_compression" in causes:
        force = drives / (1 + rng.uniform(0.02, 1.0) * (drives / drives.max()) ** 2)
    reach = 0.375 * f0 * alpha * strongest**2
    frequency = np.linspace(f0 - 8 * w, f0 + 8 * w + 0.8 * reach, n)
    volts = np.empty((8, n), complex)
    state, drive = np.zeros(8, complex), peak * force
    for k in range(n):
        point = np.where(direction > 0, k, n - 1 - k)
        detuning = 2 * (f0 - frequency[point]) / w
        for _ in range(700):
            state = _step(state, 0.03, detuning, 0.75 * f0 / w * alpha, eta / 4, drive)
        volts[np.arange(8), point] = state
    signal = per_volt * volts * np.exp(1j * rng.uniform(-np.pi, np.pi))
    if "nonlinear_readout" in causes:
        z = 4 * np.pi / WAVELENGTH * rng.uniform(0.5, 1.0) * np.abs(volts)
        tau = 2 * np.pi * np.arange(64) / 64
        first = 2 * np.mean(np.sin(z[..., None] * np.cos(tau)) * np.cos(tau), axis=-1)
        signal = signal * first / z
    if "crosstalk" in causes:
        signal = signal + rng.uniform(0.002, 0.05) * per_volt * peak * np.exp(2j * np.pi * rng.uniform()) * drives[:, None]
    noisy = signal + noise * (rng.standard_normal(signal.shape) + 1j * rng.standard_normal(signal.shape))
    return measurement.response(
        frequency, noisy, noise_sd=noise, wavelength=WAVELENGTH, mode="2,2", drive=drives, direction=direction, x=6e-5, y=6e-5
    )


def _step(a: NDArray[np.complex128], h: float, delta: Array, cubic: float, loss: float, drive: Array) -> NDArray[np.complex128]:
    """One Runge–Kutta step of da/ds = −i (drive − a (δ + cubic|a|² + i (1 + loss|a|²)))."""

    def rate(a: NDArray[np.complex128]) -> NDArray[np.complex128]:
        x = np.abs(a) ** 2
        return np.asarray(-1j * (drive - a * (delta + cubic * x + 1j * (1 + loss * x))))

    one = rate(a)
    two = rate(a + h / 2 * one)
    three = rate(a + h / 2 * two)
    return np.asarray(a + h / 6 * (one + 2 * two + 2 * three + rate(a + h * three)))


@cache
def _shapes(points: int) -> tuple[Array, Array]:
    """Axis, and ξ of the four lowest modes by cubic elements on a mesh of its own, (4, n, n)."""
    model: Model = geometry.load(GEOMETRY)
    domain = mesh(model, "half", 0.8)
    modes = solve_modes(prestress.solve_prestress(domain, 3), 4, 3)
    axis = np.linspace(-162e-6, 162e-6, points)
    return axis, np.stack([shape_at(modes, k, axis[None, :], axis[:, None]) for k in range(4)])


def harmonic_map(causes: tuple[str, ...], rng: np.random.Generator, points: int = 41) -> xr.Dataset:
    """Maps of six harmonics of the fundamental mode: v(t) sampled over a period, then an FFT."""
    axis, shapes = _shapes(points)
    x, y = np.meshgrid(axis, axis)
    q, noise, contrast = 4 * np.pi / WAVELENGTH, 3e-4, 0.02
    shape = shapes[0]
    if "mode_admixture" in causes:
        shape = shape + rng.uniform(0.01, 0.06) * shapes[rng.integers(1, 4)]
    theta = np.full(x.shape, rng.uniform(0.3, 1.2))
    if "phase_tilt" in causes:
        gx, gy = rng.uniform(200, 3000) * np.array([np.cos(a := rng.uniform(0, 2 * np.pi)), np.sin(a)])
        theta = theta + gx * x + gy * y
    if "static_bow" in causes:
        theta = theta + _sign(rng) * rng.uniform(0.1, 1.0) * shapes[0]
    tau = 2 * np.pi * np.arange(96) / 96
    u = rng.uniform(2.5e-7, 4.5e-7) * shape[..., None] * np.cos(tau)
    v = contrast * np.cos(q * u + theta[..., None])
    if "detector_saturation" in causes:
        limit = contrast * (1 - rng.uniform(0.05, 0.4))
        v = np.clip(v, -limit, limit)
    values = 2 * np.moveaxis(np.fft.fft(v, axis=-1)[..., 1:7], -1, 0) / 96
    order = np.arange(1, 7)
    omega = 2 * np.pi * 1.49e6
    if "trigger_jitter" in causes:
        values = values * np.exp(-((order * omega * rng.uniform(1e-8, 4e-8)) ** 2) / 2)[:, None, None]
    if "detector_bandwidth" in causes:
        values = values / (1 + 1j * order * omega * rng.uniform(1e-9, 3e-8))[:, None, None]
    values = values + noise * (rng.standard_normal(values.shape) + 1j * rng.standard_normal(values.shape))
    return measurement.harmonic_map(axis, axis, order, values, noise_sd=noise, wavelength=WAVELENGTH)


def series(causes: tuple[str, ...], rng: np.random.Generator, n: int = 25) -> xr.Dataset:
    """Frequency and quality factor against whatever the cause depends on."""
    f, q = np.full(n, 1.5e6), np.full(n, 5e5)
    control = {"pressure": np.geomspace(0.1, 100, n)}
    if "gas_damping" in causes:
        q = 1 / (1 / q + rng.uniform(2e-9, 1e-7) * control["pressure"])
    if "thermal_stress" in causes:
        control = {"temperature": np.linspace(290, 310, n)}
        f = f * np.sqrt(1 - _sign(rng) * rng.uniform(1e-6, 1e-4) * (control["temperature"] - 300))
    if "photothermal" in causes:
        control = {"laser_power": np.linspace(1e-6, 1e-4, n)}
        f = f * (1 + _sign(rng) * rng.uniform(0.2, 5) * control["laser_power"])
    noise = rng.standard_normal((2, n))
    return measurement.series(control, f + 2 * noise[0], np.full(n, 2.0), q * (1 + 0.01 * noise[1]), 0.01 * q)
