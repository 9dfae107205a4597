"""What changes of a film's tension do to its modes, solved on the film's own mesh."""

from femnl.mechanics.tension.effective import solve_tension

__all__ = ["solve_tension"]
