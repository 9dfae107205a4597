"""How well the ledge and its rivals account for the measured f22 − 2 f11 = 249 Hz of device J10.

Each cause adds a drawn shift to the draws of the film on its ledge. Its evidence is the density of
the sum at 249 ± 5 Hz; its posterior is that times its prior, over the sum. The priors are stated
here and are opinions: only ratios of 10 and more say anything.

- frame: a mode of the chip at a distance Δ, Γ wide, broadens (1,1) by w = 131 Hz and shifts it by
  w Δ/Γ (two coupled oscillators, g ≪ Γ). Γ = f/Q with Q = 100 … 1000 is 1.5 … 15 kHz and the modes
  of a chip of 6 × 10 × 0.5 mm are 18 kHz apart (plate waves: 41 kHz for bending, 32 kHz in plane),
  so Δ/Γ is even within half of 18 kHz over Γ.
- drift: the film cools or warms between the two modes, 25 ppm (one standard deviation) as 0.15 K
  would do at 150 ppm/K = E Δα/(2 σ (1 − ν)); the stage was controlled.
- particle: δf/f = −2 m ξ²/M, evenly over the film, mass evenly in its logarithm, 0.1 … 100 pg. It
  mixes (1,2) with (2,1), whose nodal lines the paper's maps show bent a little.
- unknown: anything within ± 1 kHz, such as unevenness of the film's stress.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MEASURED = 249.0
SPREAD = 5.0  # Hz, of the two frequencies
F11 = 1.466060e6
F22 = 2.932369e6
F12 = np.sqrt(5 / 2) * F11
EXCESS = 135.0 - 4.0  # Hz, width of (1,1) beyond that of (2,2)
SPACING = 18e3  # Hz, of the chip's modes
DRIFT = 25e-6
FILM_MASS = 5.52e-4 * (270e-6) ** 2  # kg
SPLIT = 100e-6 * F12  # Hz, of (1,2) and (2,1) by the film's own unevenness, one standard deviation
WEAK = 0.4  # rad, of mixing: a bent nodal line, not a turned one

UNKNOWN = 1000.0  # Hz, half the width of what nobody thought of

PRIOR = {
    "the ledge alone": 0.4,
    "frame mode": 0.35,
    "drift": 0.1,
    "particle": 0.05,
    "unknown": 0.1,
}


def frame(rng: np.random.Generator, count: int) -> Array:
    """Shift of f22 − 2 f11 [Hz] by a mode of the chip that broadens (1,1) as measured."""
    width = F11 / np.exp(rng.uniform(np.log(100), np.log(1000), count))
    distance = rng.uniform(-SPACING / 2, SPACING / 2, count)
    return np.asarray(-2 * EXCESS * distance / width)


def drift(rng: np.random.Generator, count: int) -> Array:
    """Shift [Hz] by a change between the measurements of the two modes."""
    return np.asarray(F22 * rng.normal(0, DRIFT, count))


def particle(rng: np.random.Generator, count: int) -> tuple[Array, Array, Array]:
    """Shift [Hz] by a particle, its mass [kg], and the angle [rad] at which (1,2) and (2,1) mix."""
    mass = 1e-15 * np.exp(rng.uniform(np.log(0.1), np.log(100), count))
    x, y = rng.uniform(0, 1, (2, count))
    first, second = np.sin(np.pi * x) * np.sin(np.pi * y), np.sin(2 * np.pi * x)
    second = second * np.sin(2 * np.pi * y)
    share = 2 * mass / FILM_MASS
    shift = share * (2 * F11 * first**2 - F22 * second**2)
    one = np.sin(np.pi * x) * np.sin(2 * np.pi * y)
    other = np.sin(2 * np.pi * x) * np.sin(np.pi * y)
    own = rng.normal(0, SPLIT, count)
    angle = np.arctan2(2 * share * F12 * one * other, own + share * F12 * (one**2 - other**2)) / 2
    turn = np.minimum(np.abs(angle), np.pi / 2 - np.abs(angle))
    return shift, mass, turn


def density(values: Array) -> float:
    """Density [1/Hz] of draws at the measured number, with a kernel of a tenth of their width."""
    width = max(SPREAD, float(np.std(values)) / 10)
    kernel = np.exp(-(((values - MEASURED) / width) ** 2) / 2) / np.sqrt(2 * np.pi) / width
    return float(kernel.mean())


def weigh(ledge: Array, seed: int = 2) -> Iterator[str]:
    """Evidence and posterior of each cause, and what each needs; `ledge`, draws [Hz] (n,)."""
    rng = np.random.default_rng(seed)
    count = len(ledge)
    grains, mass, turn = particle(rng, count)
    allowed = turn < WEAK
    evidence = {
        "the ledge alone": density(ledge),
        "frame mode": density(ledge + frame(rng, count)),
        "drift": density(ledge + drift(rng, count)),
        "particle": density((ledge + grains)[allowed]) * float(allowed.mean()),
        "unknown": density(ledge + rng.uniform(-UNKNOWN, UNKNOWN, count)),
    }
    total = sum(PRIOR[name] * value for name, value in evidence.items())
    for name, value in evidence.items():
        yield (
            f"{name}: prior {PRIOR[name]:.2f}, density {value * 1e3:.4f} per kHz, "
            f"posterior {PRIOR[name] * value / total:.2f}"
        )
    lack = float(ledge.mean()) - MEASURED
    yield f"to make up {lack:.0f} Hz:"
    yield f"  frame mode: f11 raised by {lack / 2:.0f} Hz, at {lack / 2 / EXCESS:.1f} of its width"
    yield f"  drift: {lack / F22 * 1e6:.0f} ppm between the two modes"
    grain = lack * FILM_MASS / (2 * F22 * (1 - 0.25))
    yield f"  particle: {grain * 1e15:.1f} pg at an antinode of (2,2)"
    near = allowed & (np.abs(ledge + grains - MEASURED) < 50)
    if near.any():
        low, high = np.quantile(mass[near], [0.16, 0.84]) * 1e15
        span = f"{low:.0f} … {high:.0f} pg"
        yield f"  particle within 50 Hz that leaves the pair's nodal lines: {span}"
