"""Fits of traces: harmonics of a periodic voltage, and the motion at one spot."""

from femnl.fits.trace.decompose import decompose
from femnl.fits.trace.jitter import align
from femnl.fits.trace.spot import fit_spot

__all__ = ["align", "decompose", "fit_spot"]
