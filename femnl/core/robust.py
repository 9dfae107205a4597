"""Scatter that a few outliers do not change."""

MAD = 1.482602218505602
"""Standard deviation of a normal distribution over its median absolute deviation."""
