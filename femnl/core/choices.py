"""Words that a user chooses from; they stand here so that help is printed without any library."""

from typing import Literal

Certified = Literal["frequency", "all"]
"""Numbers that a tolerance is of: f and f/f₁, or m_eff, k₃ and α as well."""
Use = Literal["complex", "magnitude", "phase", "phase-mod-pi"]
"""What a fit takes of measured amplitudes."""
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
