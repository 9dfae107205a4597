"""The measurement file, version 1.2, as data.

Which kinds there are and which datasets each has, with dimensions and units.
"""

from femnl.core.kinds import CONTROLS, Contract, Item, contracts

__all__ = ["CONTROLS", "KINDS", "VERSION", "Contract", "Item"]

VERSION = "1.2"
KINDS = contracts()
"""What a group of each kind holds."""
LEAST = 1e-30
MOST = 1e30
"""Sizes in SI units beyond which no laboratory measures; sums of their squares stay finite."""
MOST_DECIBELS = 600.0
"""The same for levels: 600 dB are a factor of 10³⁰ in amplitude."""
