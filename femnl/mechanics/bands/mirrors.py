"""Cells that have the mirror lines which bands need."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from femnl.core.device import Model
from femnl.core.errors import ParameterError
from femnl.device.mesh import WEDGES, has_symmetry
from femnl.mechanics.bands.cell_layers import Frame, cell_layers
from femnl.mechanics.bands.lattice import Cell, Symmetry


@dataclass(frozen=True)
class Candidate:
    """A cell without layers, which may have mirror lines, and where it lies on the device."""

    bare: Cell
    frame: Frame

    def layered(self, model: Model) -> Cell:
        """Return the cell with the layers of a device."""
        return replace(self.bare, layers=cell_layers(model, self.frame))


def with_mirrors(cell: Cell, model: Model) -> Cell | None:
    """Return the cell with the word for its mirror lines, or None where it lacks them."""
    device = cell.of(model)
    words: tuple[Symmetry, ...] = ("twelfth",)
    if cell.lattice.turns == 4:
        words = ("eighth", "quarter")
    for word in words:
        if has_symmetry(device, WEDGES[word]):
            return replace(cell, symmetry=word)
    return None


def no_mirrors(model: Model, candidates: Sequence[Candidate]) -> ParameterError:
    """Return an error that names a layer for which no cell has mirror lines, else the holes."""
    lattice = candidates[0].frame.lattice
    wanted = "along x and y" if lattice.turns == 4 else "at every 30°"
    if any(with_mirrors(candidate.bare, model) for candidate in candidates):
        for number, lamina in enumerate(model.layers, start=1):
            alone = replace(model, layers=(lamina,))
            if not any(with_mirrors(one.layered(alone), model) for one in candidates):
                return ParameterError(
                    f"{model.name}: [layers] {number} {lamina.name}: lacks mirror lines {wanted} "
                    f"in the cell of the {lattice.kind} lattice; bands need them"
                )
        return ParameterError(
            f"{model.name}: [layers]: together they lack mirror lines {wanted} in the cell of the "
            f"{lattice.kind} lattice; bands need them"
        )
    return ParameterError(
        f"{model.name}: holes: the cell of their {lattice.kind} lattice lacks mirror lines "
        f"{wanted}; bands need them"
    )
