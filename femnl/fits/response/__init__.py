"""Fits of driven responses."""

from femnl.fits.response.fit import fit_response, predict_response
from femnl.fits.response.linescan import fit_line_scan

__all__ = ["fit_line_scan", "fit_response", "predict_response"]
