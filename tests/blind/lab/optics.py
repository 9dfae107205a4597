"""What the detector gives for a stack of layers: reflections layer by layer, angle by angle.

A focused beam is a sum of plane waves, of which each reflects by itself in both polarisations.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from femnl.core.device import Stack
from tests.blind.lab.bench import Array, Values

ANGLES = 32
"""Plane waves of a focused beam, by Gauss–Laguerre in the square of their sine."""
STEP = 1e-9
"""Step [m] of the gap at which a fringe is tabulated; the spline between errs by 1e-9 of it."""
BEYOND = 2e-6
"""How far [m] the table goes to both sides of the gap."""
FINE = 4096
"""Samples of a period in which a low pass is run."""
PERIODS = 4
"""Periods after which it is steady."""


def reflection(
    stack: Stack, gap: Array, wavelength: float, sine_square: float = 0.0, s_wave: bool = True
) -> Array:
    """R of the stack for a plane wave, layer by layer from the wafer up.

    r = (r₀ + r e^{−2ikd})/(1 + r₀ r e^{−2ikd}); sine_square: of the angle before the stack.
    """
    index = [_index(layer.index, wavelength) for layer in stack.layers]
    cosine = [np.sqrt(1 - sine_square * (index[0] / n) ** 2) for n in index]
    # What is steady across a face: E and n cos ϑ E, or cos ϑ E and n E
    weight = [n * c if s_wave else n / c for n, c in zip(index, cosine, strict=True)]
    inner = np.zeros(np.shape(gap), complex)
    for k in range(len(index) - 2, -1, -1):
        face = (weight[k] - weight[k + 1]) / (weight[k] + weight[k + 1])
        if k + 1 < len(index) - 1:
            depth = gap if k + 1 == stack.gap else stack.layers[k + 1].thickness
            way = index[k + 1] * cosine[k + 1] * depth
            inner = inner * np.exp(-4j * np.pi / wavelength * way)
        inner = (face + inner) / (1 + face * inner)
    return np.asarray(np.abs(inner) ** 2)


def beam_reflection(stack: Stack, gap: Array, wavelength: float, aperture_square: float) -> Array:
    """R for a linearly polarised Gaussian beam, whose power falls as e^{−2 sin²ϑ/NA²}."""
    if aperture_square == 0:
        return reflection(stack, gap, wavelength)
    place, share = np.polynomial.laguerre.laggauss(ANGLES)
    total = np.zeros(np.shape(gap))
    for t, weight in zip(place, share, strict=True):
        square = aperture_square * t / 2
        if square < 1:  # beyond, nothing travels
            for s_wave in (True, False):
                total += weight / 2 * reflection(stack, gap, wavelength, square, s_wave)
    return total


def with_film(stack: Stack, values: Values) -> Stack:
    """The stack with the film that `values` say, thickness [m] and index in that of the file."""
    layers = list(stack.layers)
    film = layers[stack.gap - 1]
    scale = values.get("index_scale", 1.0)
    layers[stack.gap - 1] = replace(
        film,
        thickness=values.get("thickness", film.thickness),
        index=tuple((wavelength, n * scale) for wavelength, n in film.index),
    )
    return replace(stack, layers=tuple(layers))


def fringe(stack: Stack, values: Values, wavelength: float) -> Callable[[Array], Array]:
    """R against the gap [m], less its mean and in units of its first Fourier coefficient.

    values: gap, and what the film and the beam are beyond the file. Both numbers are those of the
    half wavelength around the gap.
    """
    return _tabulated(stack, tuple(values.items()), wavelength)


@lru_cache(maxsize=64)
def _tabulated(
    stack: Stack, values: tuple[tuple[str, float], ...], wavelength: float
) -> Callable[[Array], Array]:
    known = dict(values)
    middle = known["gap"]
    gap = np.arange(max(middle - BEYOND, 0.0), middle + BEYOND, STEP)
    read = beam_reflection(
        with_film(stack, known), gap, wavelength, known.get("aperture_square", 0.0)
    )
    table = CubicSpline(gap, read)
    period = middle + wavelength / 2 * (np.arange(512) / 512 - 0.5)
    whole = table(period)
    first = 2 * abs(np.mean(whole * np.exp(4j * np.pi * period / wavelength)))
    return lambda there: np.asarray((table(there) - whole.mean()) / first)


def largest(stack: Stack, values: Values, wavelength: float) -> float:
    """Largest size of that fringe, at any gap."""
    gap = values["gap"] + wavelength / 2 * (np.arange(4096) / 4096 - 0.5)
    return float(np.abs(fringe(stack, values, wavelength)(gap)).max())


def _index(table: tuple[tuple[float, complex], ...], wavelength: float) -> complex:
    wavelengths, values = zip(*sorted(table, key=lambda row: row[0]), strict=True)
    return complex(np.interp(wavelength, wavelengths, np.array(values)))


@lru_cache(maxsize=256)
def low_passed(count: int, frequency: float, time_constant: float) -> Array:
    """Complex answers of τ v̇ + v = s to the harmonics 0 … count−1, run in time until steady.

    s is straight from sample to sample, where the filter is exact.
    """
    step = 1 / (frequency * FINE * time_constant)
    keep = np.exp(-step)
    slope = (1 - keep) / step
    tau = 2 * np.pi * np.arange(FINE) / FINE
    tones = np.exp(1j * np.outer(np.arange(count), tau))
    run = lfilter([1 - slope, slope - keep], [1, -keep], np.tile(tones, PERIODS), axis=-1)
    return np.asarray(np.mean(run[:, -FINE:] / tones, axis=-1))
