"""The first eigenvalue of the L-shaped membrane."""

from collections.abc import Iterator
from math import pi

import femnl
from femnl.device import geometry
from femnl.validation import Case, Reference

GEOMETRY = """
name = "l-shape"
source = "the classical test of corners: three unit squares around a corner of 270°"
[outline]
kind = "polygon"
points = [
    ["0 m", "0 m"], ["1 m", "0 m"], ["1 m", "1 m"],
    ["-1 m", "1 m"], ["-1 m", "-1 m"], ["0 m", "-1 m"],
]
[film]
thickness = "1 um"
young = "250 GPa"
poisson = 0.23
density = "1000 kg/m^3"
stress = "1000 MPa"
[model]
bending = false
"""


def compute() -> Iterator[tuple[float, float]]:
    """Solve the whole film, whose wave speed is 1000 m/s."""
    modes = femnl.solve_modes(geometry.parse(GEOMETRY), count=1, resolution=2, cache=False)
    frequency = modes.frequency[0]
    error = modes.frequency_error[0]
    yield (2 * pi * frequency / 1000) ** 2, 2 * (2 * pi / 1000) ** 2 * frequency * error


CASE = Case(
    claim="The L-shaped membrane's first eigenvalue is right to 1e-8 despite its corner of 270°",
    source="Betcke & Trefethen, SIAM Rev. 47, 469 (2005): λ1 = 9.6397238440219; one more digit "
    "from Trefethen's later "
    "computations",
    references=(Reference("λ1", 9.639723844021941, relative=1e-8),),
    compute=compute,
)
