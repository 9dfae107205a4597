"""Chips of many devices: what they share, how they vary over the chip, and which deviate."""

from typing import TYPE_CHECKING

from femnl.core.lazy import lazy_names

if TYPE_CHECKING:  # what a type checker reads; at run time the names load when they are first used
    from femnl.chip.fit import fit_chip as fit_chip
    from femnl.chip.members import Chip as Chip
    from femnl.chip.result import ChipFit as ChipFit
    from femnl.chip.study import read_chip as read_chip

# A study that cannot be read is refused before the fits load
_HOMES = {
    "Chip": "femnl.chip.members",
    "ChipFit": "femnl.chip.result",
    "fit_chip": "femnl.chip.fit",
    "read_chip": "femnl.chip.study",
}
__all__ = [*_HOMES]
__getattr__ = lazy_names(__name__, _HOMES)
