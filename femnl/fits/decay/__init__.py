"""Fits of decays."""

from femnl.fits.decay.ringdown import fit_ringdown, fit_ringdown_trace, predict_ringdown

__all__ = ["fit_ringdown", "fit_ringdown_trace", "predict_ringdown"]
