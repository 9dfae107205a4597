"""Fits of a record of drive and output."""

from femnl.fits.record.oscillator import fit_oscillator, simulate_oscillator
from femnl.fits.record.terms import fit_terms

__all__ = ["fit_oscillator", "fit_terms", "simulate_oscillator"]
