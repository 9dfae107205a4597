"""Ratios of the two triangles whose membrane modes are sines."""

from collections.abc import Iterator
from math import sqrt

import femnl
from femnl.device import geometry
from femnl.validation import Case, Reference

GEOMETRY = """
name = "triangle"
source = "a film of wave speed 1 m/s"
[outline]
{outline}
[film]
thickness = "1 um"
young = "250 GPa"
poisson = 0.3
density = "1 kg/m^3"
stress = "1 Pa"
[model]
bending = false
"""
EQUILATERAL = 'kind = "regular-polygon"\nsides = 3\nlong_axis = "2 m"'
RIGHT = 'kind = "polygon"\npoints = [["0 m", "0 m"], ["1 m", "0 m"], ["0 m", "1 m"]]'
RATIOS = (sqrt(7 / 3), sqrt(7 / 3), 2.0, sqrt(13 / 3), sqrt(13 / 3))
ORDERS = ((3, 1), (3, 2), (4, 1), (4, 2), (4, 3))


def compute() -> Iterator[tuple[float, float]]:
    """Solve both triangles, finer than usual: their corners are sharp."""
    for outline, count in ((EQUILATERAL, 1 + len(RATIOS)), (RIGHT, 1 + len(ORDERS))):
        model = geometry.parse(GEOMETRY.format(outline=outline))
        modes = femnl.solve_modes(model, count=count, cache=False)
        yield from zip(modes.ratio[1:], modes.ratio_error[1:], strict=True)


CASE = Case(
    claim="Membranes in the form of an equilateral and of a right isosceles triangle ring at the "
    "ratios of their closed forms",
    source="equilateral, f² ∝ m² + mn + n²: Lamé, Leçons sur la théorie mathématique de "
    "l'élasticité (1852), §57, and McCartin, SIAM Rev. 45, 267 (2003); right isosceles, modes "
    "of the square odd about its diagonal, f² ∝ m² + n², m ≠ n: Rayleigh, The Theory of Sound "
    "(1894), §199",
    references=(
        *(
            Reference(f"equilateral, f{k + 2}/f1", value, relative=1e-6)
            for k, value in enumerate(RATIOS)
        ),
        *(
            Reference(
                f"right isosceles, f({m},{n})/f(2,1)", sqrt((m * m + n * n) / 5), relative=1e-6
            )
            for m, n in ORDERS
        ),
    ),
    compute=compute,
)
