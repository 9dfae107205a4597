"""Films that are bent at rest: their frequencies and their quadratic and cubic coefficients."""

from femnl.mechanics.static_deflection.film import Film
from femnl.mechanics.static_deflection.shallow import refuse_rest
from femnl.mechanics.static_deflection.solve import StaticDeflection, solve_static_deflection

__all__ = ["Film", "StaticDeflection", "refuse_rest", "solve_static_deflection"]
