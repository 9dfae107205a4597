"""Words that a user chooses from; they stand here so that help is printed without any library."""

from typing import Literal, get_args

from femnl.core.errors import ParameterError

Certified = Literal["frequency", "all"]
"""Numbers that a tolerance is of: f and f/f₁, or m_eff, k₃ and α as well."""
Use = Literal["complex", "magnitude", "phase", "phase-mod-pi"]
"""What a fit takes of measured amplitudes."""
Edge = Literal["clamped", "sliding", "paper"]
"""How the film is held in its plane, as its nonlinearity sees it."""
Symmetry = Literal["full", "half", "quarter", "eighth", "twelfth"]
"""Parts of a film that may be meshed."""
PICTURES = ("mesh", "stress", "shape", "thickness")
"""What femnl draws of a film."""
PICTURE_FORMATS = (".png", ".pdf", ".svg")
"""Endings of the files that a picture of a film may be written to."""
Background = Literal["none", "constant", "slope"]
"""What lies behind a resonance: nothing, C₀, or C₀ + C₁(f − f₀), complex."""
Law = Literal["line", "power", "arrhenius"]
"""What a series follows: a + b x, c x^p, or A exp(−E/(k_B T))."""


def check_symmetry(symmetry: str) -> str:
    """Return the word for the part of a film that is meshed.

    Raises: ParameterError where it is none.
    """
    if symmetry not in ("auto", *get_args(Symmetry)):
        raise ParameterError(
            f'symmetry = "{symmetry}": expected auto, {", ".join(get_args(Symmetry))}'
        )
    return symmetry


def check_resolution(resolution: float) -> float:
    """Return a factor on the number of elements per length.

    Raises: ParameterError where no mesh is made for it.
    """
    if not 0.1 <= resolution <= 20:
        raise ParameterError(f"resolution = {resolution:g}: expected a number from 0.1 to 20")
    return resolution
