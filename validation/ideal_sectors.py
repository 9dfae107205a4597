"""Circular and annular sectors, also wider than a half turn."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import cos, pi, radians, sin

import femnl
from femnl.device import geometry
from femnl.validation import Case, Reference

FILM = """
[film]
thickness = "1 um"
young = "250 GPa"
poisson = 0.3
density = "1 kg/m^3"
stress = "1 Pa"
[model]
bending = false
"""


@dataclass(frozen=True)
class Sector:
    """A sector of radius 1 m without its part within `inner` [m].

    roots: k of the lowest modes: J_ν(k) = 0, or with an inner rim J_ν(k) Y_ν(kb) = J_ν(kb) Y_ν(k),
    where ν = mπ/angle.
    """

    degrees: float
    inner: float
    roots: tuple[float, ...]

    def name(self) -> str:
        """Say which sector it is."""
        kind = f"annular sector, b/a = {self.inner:g}" if self.inner else "sector"
        return f"{self.degrees:g}° {kind}"


SECTORS = (
    Sector(60, 0.0, (6.3801618959, 9.76102313, 9.9361095242, 13.0152007217)),
    Sector(270, 0.0, (3.3756106527, 4.2753407188, 5.1356223018, 5.9701388464)),
    Sector(90, 0.5, (6.8138428531, 8.2667304354, 10.1889299236, 12.3113085972)),
    Sector(270, 0.25, (4.2578845945, 4.6958562834, 5.3198678702, 6.044838102)),
)


def point(radius: float, degrees: float) -> str:
    """Return a point of a file by its polar coordinates."""
    x, y = radius * cos(radians(degrees)), radius * sin(radians(degrees))
    return f'["{round(x, 14) + 0.0!r} m", "{round(y, 14) + 0.0!r} m"]'


def outline(sector: Sector) -> str:
    """Return the table of a sector's outline."""
    wide = sector.degrees
    corners = [point(1, 0), point(1, wide)]
    arcs = [f"{{edge = 1, through = {point(1, wide / 2)}}}"]
    if sector.inner:
        corners += [point(sector.inner, wide), point(sector.inner, 0)]
        arcs.append(f"{{edge = 3, through = {point(sector.inner, wide / 2)}}}")
    else:
        corners.append(point(0, 0))
    return (
        f'[outline]\nkind = "polygon"\npoints = [{", ".join(corners)}]\narcs = [{", ".join(arcs)}]'
    )


def compute() -> Iterator[tuple[float, float]]:
    """Solve one sector after the other."""
    for sector in SECTORS:
        model = geometry.parse(f'name = "sector"\n{outline(sector)}\n{FILM}')
        modes = femnl.solve_modes(model, count=len(sector.roots), cache=False)
        yield from zip(2 * pi * modes.frequency, 2 * pi * modes.frequency_error, strict=True)


CASE = Case(
    claim="Membranes that are sectors of discs and of rings ring at the roots of Bessel functions "
    "of fractional order, also around an inner corner of 270°",
    source="Rayleigh, The Theory of Sound I (1877), § 207: order ν = mπ/β at an angle β; with an "
    "inner rim Abramowitz & Stegun, section 9.5.27; roots by the Bessel functions of SciPy",
    references=tuple(
        Reference(f"ωa/c of mode {k + 1}, {sector.name()}", value, relative=1e-7)
        for sector in SECTORS
        for k, value in enumerate(sector.roots)
    ),
    compute=compute,
)
