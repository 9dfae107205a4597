"""The measurement file, version 1.2, as data.

Which kinds there are and which datasets each has, with dimensions and units.
"""

from femnl.core.kinds import CONTROLS, Contract, Item, contracts

__all__ = ["CONTROLS", "KINDS", "VERSION", "Contract", "Item"]

VERSION = "1.2"
KINDS = contracts()
"""What a group of each kind holds."""
