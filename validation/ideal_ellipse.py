"""The elliptical membrane."""

from collections.abc import Iterator
from math import pi

import femnl
from femnl.device import geometry
from femnl.validation import Case, Reference

# ω/c times half the long axis, by the ratio of the axes: roots of the radial Mathieu functions
ROOTS = {
    0.9: (2.54155773, 3.94153081, 4.15418059, 5.33793189, 5.4261645, 5.91529156),
    0.5: (3.77715586, 5.01016192, 6.33353033, 6.8517634, 7.71422171, 7.98096836),
}
GEOMETRY = """
name = "ellipse"
source = "a film of wave speed 1 m/s"
[outline]
kind = "ellipse"
width = "2 m"
height = "{height} m"
[film]
thickness = "1 um"
young = "250 GPa"
poisson = 0.3
density = "1 kg/m^3"
stress = "1 Pa"
[model]
bending = false
"""


def compute() -> Iterator[tuple[float, float]]:
    """Solve one ellipse after the other."""
    for ratio, roots in ROOTS.items():
        model = geometry.parse(GEOMETRY.format(height=2 * ratio))
        modes = femnl.solve_modes(model, count=len(roots), cache=False)
        yield from zip(2 * pi * modes.frequency, 2 * pi * modes.frequency_error, strict=True)


CASE = Case(
    claim="An elliptical membrane rings at the roots of the modified Mathieu functions",
    source="McLachlan, Theory and Application of Mathieu Functions (1947), section 16.10 and "
    "following: Ce_m(ξ₀, q) = 0 or Se_m(ξ₀, q) = 0 with q = (ωe/2c)², e the distance of a focus "
    "from the centre and tanh ξ₀ the ratio of the axes; roots by the Mathieu functions of SciPy",
    references=tuple(
        Reference(f"ωa/c of mode {k + 1}, axes as 1 to {ratio}", value, relative=1e-6)
        for ratio, roots in ROOTS.items()
        for k, value in enumerate(roots)
    ),
    compute=compute,
)
