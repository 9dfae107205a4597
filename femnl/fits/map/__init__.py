"""Fits of harmonic maps."""

from femnl.fits.map.fit import fit_map

__all__ = ["fit_map"]
