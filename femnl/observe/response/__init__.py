"""Driven responses: sweeps over the frequency of the drive."""
