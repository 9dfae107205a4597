"""Edges that give way: a drum on springs, a hinged plate, a disc that draws its edge in."""

from collections.abc import Iterator
from math import pi

import numpy as np

from femnl.core.domain import Prestress
from femnl.device import geometry
from femnl.device.mesh import mesh
from femnl.mechanics.fem.stress import relaxed_stress
from femnl.mechanics.modes import solve_modes
from femnl.mechanics.prestress import solve_prestress
from femnl.validation import Case, Reference

# Roots of βJ₁(β) = C J₀(β), and of βJ₁'(β) + C J₁(β) = 0 for one nodal diameter; C = k R/T.
ROBIN = {
    0.1: (0.4416817829, 1.9153928588),
    1.0: (1.2557837118, 2.4048255577),
    10.0: (2.1794965967, 3.4797593229),
}
LAYER = 0.05  # ℓ/L of the hinged plate
STIFFNESS = 3e9  # Pa, of the disc's edge
GEOMETRY = """
name = "edge"
source = "a film of σ = 1 GPa, h = 1 cm, E = 1 TPa"
[outline]
{outline}
[film]
thickness = "1 cm"
young = "{young:.15g} Pa"
poisson = 0.3
density = "1000 kg/m^3"
stress = "1 GPa"
[model]
bending = {bending}
[clamp]
{clamp}
"""
CIRCLE = 'kind = "circle"\ndiameter = "2 m"'
SQUARE = 'kind = "square"\nside = "1 m"'


def relaxed(outline: str, clamp: str, young: float = 1e12, bending: str = "false") -> Prestress:
    """The film at rest on its edge."""
    model = geometry.parse(
        GEOMETRY.format(outline=outline, clamp=clamp, young=young, bending=bending)
    )
    return solve_prestress(mesh(model), 4)


def compute() -> Iterator[float]:
    """ωR/c of drums, ωL/c of the hinged plate, and the stress of the disc."""
    for ratio in ROBIN:
        modes = solve_modes(relaxed(CIRCLE, f'deflection = "{ratio * 1e7} Pa"'), 2, 4)
        yield from 2 * pi * modes.frequency / 1e3
    young = 12 * (1 - 0.3**2) * 1e9 * (LAYER / 0.01) ** 2
    yield from (
        2
        * pi
        * solve_modes(relaxed(SQUARE, 'rotation = "0 N"', young, "true"), 4, 4).frequency[[0, 1, 3]]
        / 1e3
    )
    yield (
        float(
            np.mean(
                np.concatenate(
                    [
                        s.ravel()
                        for s in relaxed_stress(relaxed(CIRCLE, f'normal = "{STIFFNESS} Pa"'), 8)
                    ]
                )
            )
        )
        * 1.5
        / 1e9
    )


CASE = Case(
    claim="Springs at the edge give Bessel's Robin problem, hinges Navier's plate, and springs "
    "in plane an evenly "
    "relaxed disc",
    source="drum: Carslaw & Jaeger, Conduction of Heat in Solids (1959), appendix IV, table III "
    "(β = 0.4417, 1.2558, "
    "2.1795), "
    "with more "
    "digits from the same equation; plate: Navier, ω²ρh = Tk² + Dk⁴ with k² = π²(m² + n²)/L²; "
    "disc: Lamé, hσ/σ₀h = "
    "kR/(kR + "
    "Eh/(1−ν))",
    references=(
        *(
            Reference(f"ωR/c, kR/T = {ratio:g}, {nodes} nodal diameters", value, relative=2e-7)
            for ratio, roots in ROBIN.items()
            for nodes, value in enumerate(roots)
        ),
        *(
            Reference(
                f"ωL/c hinged, ({m},{n})",
                pi * np.sqrt((m * m + n * n) * (1 + (LAYER * pi) ** 2 * (m * m + n * n))),
                relative=1e-6,
            )
            for m, n in ((1, 1), (2, 1), (2, 2))
        ),
        Reference(
            "σ/σ₀ of a disc on springs", STIFFNESS / (STIFFNESS + 1e12 * 0.01 / 0.7), relative=1e-7
        ),
    ),
    compute=compute,
)
