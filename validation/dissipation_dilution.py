"""Dissipation dilution: tension lifts Q above that of bending, the clamped edge takes most back."""

from collections.abc import Iterator

import femnl
from femnl.device import geometry
from femnl.mechanics.modes.dilution import dilution
from femnl.validation import Case, Reference

FILM = """
[film]
thickness = "50 nm"
young = "270 GPa"
poisson = 0.27
density = "2700 kg/m^3"
stress = "0.9 GPa"
[model]
bending = true
"""
SQUARE = f"""
name = "square"
source = "a square membrane like those of Yu, Purdy and Regal"
[outline]
kind = "square"
side = "250 um"
{FILM}
"""
BENDING = 2 * (270e9 * 50e-9**2 / (12 * (1 - 0.27**2) * 0.9e9)) ** 0.5 / 250e-6  # λ = 2ℓ/L
ORDERS = ((1, 1), (2, 1), (2, 2), (3, 1))


def formula(m: int, n: int) -> float:
    """Q/Q_bend of Yu, Purdy and Regal."""
    return 1 / (BENDING + BENDING**2 * 3.141592653589793**2 * (m * m + n * n) / 4)


def compute() -> Iterator[tuple[float, float]]:
    """Solve the modes and share their energy out."""
    modes = femnl.solve_modes(geometry.parse(SQUARE), count=5, cache=False)
    factor, error = dilution(modes)
    for m, n in ORDERS:
        k = min(k for k, label in enumerate(modes.label) if label and f"({m},{n})" in label)
        yield float(factor[k]), float(error[k])


CASE = Case(
    claim="Q/Q_bend of a square membrane is 1/(λ + λ²π²(m² + n²)/4), λ = 2ℓ/L: edge and "
    "antinodes of the "
    "bending film",
    source="Yu, Purdy & Regal, Phys. Rev. Lett. 108, 083603 (2012), in which λ = √(Eh²/3σL²(1 − "
    "ν²)) is small; the next "
    "order in λ, "
    "which it leaves out, is a share λ of it (Fletcher, J. Acoust. Soc. Am. 36, 203 (1964))",
    references=tuple(
        Reference(f"Q/Q_bend ({m},{n})", formula(m, n), relative=BENDING) for m, n in ORDERS
    ),
    compute=compute,
    slow=True,
)
