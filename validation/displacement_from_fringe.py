"""Displacement in metres from the modulation depth z of a sinusoidal fringe."""

from collections.abc import Iterator

from scipy.optimize import brentq
from scipy.special import jv

from femnl.optics.fringe import SineFringe
from femnl.optics.harmonics import harmonics_by_fft
from femnl.validation import Case, Reference

RED = 632.8e-9
GREEN = 532e-9
FITS = (
    ("red, z = 8.85", 8.85, RED),
    ("green, z = 10.51", 10.51, GREEN),
    ("hexagon, z = 4.218", 4.218, RED),
)


def compute() -> Iterator[float]:
    """Find the amplitude whose sampled fringe has V₃/V₁ = −J₃(z)/J₁(z), near the closed form."""
    for _, z, wavelength in FITS:
        fringe = SineFringe(wavelength, offset=0.1, contrast=0.2, phase=0.7)

        def excess(amplitude: float, fringe: SineFringe = fringe, z: float = z) -> float:
            first, third = harmonics_by_fft(fringe, [1, 3], amplitude).real
            return float(third * jv(1, z) + first * jv(3, z))

        nominal = z * wavelength / 12.566370614
        yield brentq(excess, 0.99 * nominal, 1.01 * nominal, xtol=1e-18)


CASE = Case(
    claim="A fringe swept z radians deep means a motion of U = zλ/4π",
    source="arXiv:2502.19191, S7: fitted z = S′; the paper rounds to 446, 445 and 212 nm (its "
    "source text: 445.65 and "
    "444.9 nm)",
    references=tuple(
        Reference(f"U ({name})", value, "m", absolute=0.005e-9)
        for (name, _, _), value in zip(FITS, (445.66e-9, 444.94e-9, 212.40e-9), strict=True)
    ),
    compute=compute,
)
