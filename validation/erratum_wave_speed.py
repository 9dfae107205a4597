"""The wave speed of the film against its printed stress."""

from math import sqrt

from femnl.validation import Case, Reference

STRESS = 1101.5e6
DENSITY = 3100.0
PRINTED = 559.0

CASE = Case(
    claim="√(σ/ρ) of the printed stress is 596 m/s: the printed 559 m/s is an effective speed",
    source="arXiv:2502.19191, section Membrane mechanics (σ = 1101.5 MPa); ρ = 3100 kg/m³ of "
    "stoichiometric silicon nitride",
    why="559 m/s would need ρ = 3525 kg/m³, denser than any silicon nitride film; stress "
    "relaxed by holes of r "
    "≈ 1.4 µm "
    "gives the rest",
    references=(
        Reference("√(σ/ρ)", 596.09, "m/s", absolute=0.005, printed=PRINTED),
        Reference("density that 559 m/s needs", 3525.0, "kg/m³", absolute=0.5),
    ),
    compute=lambda: (sqrt(STRESS / DENSITY), STRESS / PRINTED**2),
)
