"""Chips of many devices: what they share, how they vary over the chip, and which deviate."""

from femnl.chip.fit import fit_chip
from femnl.chip.members import Chip
from femnl.chip.result import ChipFit
from femnl.chip.study import read_chip

__all__ = ["Chip", "ChipFit", "fit_chip", "read_chip"]
