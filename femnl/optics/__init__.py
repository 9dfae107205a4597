"""Readout of a displacement u: fringes f(u), and the harmonics that they make of motion."""
