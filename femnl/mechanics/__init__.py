"""Mechanics of a stressed film.

Finite elements, prestress, modes, nonlinearity, bands, lattices of holes, static deflection.
"""
