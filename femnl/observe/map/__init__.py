"""Harmonic maps: complex amplitudes of each harmonic over the film."""
