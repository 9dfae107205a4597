"""Figures: one style, one module for each part of femnl that draws."""
