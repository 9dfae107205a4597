"""The kinds of outline that a geometry file may name."""

from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from femnl.core.errors import GeometryError
from femnl.core.outline import Holes, Outline
from femnl.device.geometry import curves
from femnl.device.geometry.combined import Combined
from femnl.device.geometry.polygons import Polygon
from femnl.device.geometry.quantities import Length
from femnl.device.geometry.scallops import union_of_discs
from femnl.device.geometry.shapes import Circle, Ellipse, Rectangle, RegularPolygon, Spline, Square
from femnl.device.geometry.tables import Table
from femnl.device.geometry.webs import Trampoline, Web

Array = NDArray[np.float64]


class Etched(Table):
    """What an isotropic etch around every release hole sets free, scallops included.

    `etch_radius`: from the centre of the hole.

    Its length is the larger side of its box; a rectangular grid of holes about the origin also
    gives the box for (m,n) labels.
    """

    kind: Literal["etched"]
    etch_radius: Length

    def widened(self, width: float) -> Self:
        """Return the outline with every side moved outwards by `width` [m]."""
        return self.model_copy(update={"etch_radius": self.etch_radius + width})

    def outline(self, holes: Holes) -> Outline:
        """Return the arcs of the union of discs.

        Raises:
            GeometryError: no holes; an etch that stays inside the holes; a film in pieces or with
            pillars left under it.
        """
        if not len(holes.centres):
            raise GeometryError(
                '[outline] kind = "etched": the film is etched free around holes, write a table '
                "[holes] or another kind"
            )
        if self.etch_radius <= holes.radius:
            raise GeometryError(
                f"[outline] etch_radius = {self.etch_radius * 1e6:.4g} um: expected more than "
                "the radius of the holes, "
                f"{holes.radius * 1e6:.4g} um, as it counts from their centres"
            )
        arcs = union_of_discs(holes, self.etch_radius)
        x0, y0, x1, y1 = curves.box(Outline(self.kind, arcs, None, 0.0))
        size = (
            (x1 - x0, y1 - y0) if _is_centred_grid(holes.centres, 1e-6 * self.etch_radius) else None
        )
        return Outline(self.kind, arcs, size, max(x1 - x0, y1 - y0))


OutlineTable = Annotated[
    Square
    | Rectangle
    | RegularPolygon
    | Circle
    | Ellipse
    | Polygon
    | Spline
    | Combined
    | Etched
    | Trampoline
    | Web,
    Field(discriminator="kind"),
]


def _is_centred_grid(centres: Array, tolerance: float) -> bool:
    """Return whether the centres fill a grid of rows and columns whose middle is the origin."""
    columns, rows = (len(np.unique(np.rint(centres[:, axis] / tolerance))) for axis in (0, 1))
    middle = np.abs(centres.min(axis=0) + centres.max(axis=0)).max() / 2
    return columns * rows == len(centres) and bool(middle < tolerance)
