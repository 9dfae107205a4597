"""Whose refractive index of silicon nitride the paper's table holds."""

from math import sqrt

from femnl.validation import Case, Reference

RED = 0.6328
GREEN = 0.532


def philipp(wavelength: float) -> float:
    """Index at a wavelength in µm: n² = 1 + 2.8939/(1 − (0.13967/λ)²)."""
    return sqrt(1 + 2.8939 / (1 - (0.13967 / wavelength) ** 2))


def luke(wavelength: float) -> float:
    """Index at a wavelength in µm.

    n² = 1 + 3.0249/(1 − (0.1353406/λ)²) + 40314/(1 − (1239.842/λ)²).
    """
    return sqrt(
        1
        + 3.0249 / (1 - (0.1353406 / wavelength) ** 2)
        + 40314 / (1 - (1239.842 / wavelength) ** 2)
    )


CASE = Case(
    claim="The paper's indices of silicon nitride are those of Luke et al. 2015, not of "
    "Philipp 1973",
    source="dispersion formulas of the two works as in the refractiveindex.info database, pages "
    "Si3N4/Philipp (after Bååk, "
    "Appl. Opt. 21, "
    "1069, 1982) and Si3N4/Luke (Opt. Lett. 40, 4823, 2015); arXiv:2502.19191, table of the "
    "reflectivity calculation",
    why="the table cites Philipp 1973, whose formula gives 0.029 less; Luke 2015 gives all four "
    "printed decimals",
    references=(
        Reference("n(632.8 nm) of Philipp", 2.0105, absolute=5e-5, printed=2.0395),
        Reference("n(532 nm) of Philipp", 2.0269, absolute=5e-5, printed=2.0559),
        Reference("n(632.8 nm) of Luke", 2.0395, absolute=5e-5),
        Reference("n(532 nm) of Luke", 2.0559, absolute=5e-5),
    ),
    compute=lambda: (philipp(RED), philipp(GREEN), luke(RED), luke(GREEN)),
)
