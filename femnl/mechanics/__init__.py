"""Mechanics of a stressed film: finite elements, prestress, modes, nonlinearity, bands, lattices of holes, static deflection."""
