"""Fits of measurements: parameters with their uncertainties, and what the data leave open."""
