"""What changes of a film's tension do to its modes, solved on the film's own mesh."""

from femnl.mechanics.tension.effective import solve_tension
from femnl.mechanics.tension.effort import effort_of, less_effort

__all__ = ["effort_of", "less_effort", "solve_tension"]
