"""Fits of spectra: lines, their assignment to simulated modes, and the film."""

from femnl.fits.spectrum.assignment import assign
from femnl.fits.spectrum.film import fit_film
from femnl.fits.spectrum.overview import label_peaks, to_spectrum
from femnl.fits.spectrum.peaks import find_peaks

__all__ = ["assign", "find_peaks", "fit_film", "label_peaks", "to_spectrum"]
