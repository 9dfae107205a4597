"""Films that are bent at rest: their frequencies and their quadratic and cubic coefficients."""

from femnl.bow.film import Film
from femnl.bow.solve import Bowed, solve_bow

__all__ = ["Bowed", "Film", "solve_bow"]
