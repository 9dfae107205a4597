"""The tables of layers on the film, such as electrodes."""

from collections.abc import Sequence
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from femnl.core.device import Lamina
from femnl.core.errors import GeometryError
from femnl.core.outline import Holes, Outline
from femnl.device.geometry import curves
from femnl.device.geometry.booleans import combine
from femnl.device.geometry.combined import Combined, steps_of
from femnl.device.geometry.edges import Poisson
from femnl.device.geometry.loss import Quality
from femnl.device.geometry.naming import place, plain_name
from femnl.device.geometry.openings import polygon
from femnl.device.geometry.polygons import Polygon
from femnl.device.geometry.quantities import Density, Length, Pressure, Stress, refusal
from femnl.device.geometry.shapes import Circle, Ellipse, Rectangle, RegularPolygon, Spline, Square
from femnl.device.geometry.tables import Table

LayerShape = Annotated[
    Square | Rectangle | RegularPolygon | Circle | Ellipse | Polygon | Spline | Combined,
    Field(discriminator="kind"),
]
MOST_LAYERS = 50


class LaminaTable(Table):
    """A layer on the film; see core.device.Lamina.

    shape: what it covers of the film, which may reach beyond the film's edge and over holes. A
    combined shape may be in pieces and have holes. Without it the layer covers the whole film.
    quality_factor: of its material as it bends.
    """

    name: Annotated[str, AfterValidator(plain_name)]
    thickness: Length
    young: Pressure
    poisson: Poisson
    density: Density
    stress: Stress
    side: Literal["top", "bottom"] = "top"
    shape: LayerShape | None = None
    quality_factor: Quality | None = None

    @model_validator(mode="after")
    def _has_no_free_edges(self) -> Self:
        if isinstance(self.shape, Polygon | Combined) and self.shape.free:
            raise refusal("a layer is not held at its rim; leave free out", "shape")
        return self

    def lamina(self) -> Lamina:
        """Return the layer in SI units.

        Raises:
            GeometryError: a shape that cannot be made.
        """
        return Lamina(
            self.name,
            self.thickness,
            self.young,
            self.poisson,
            self.density,
            self.stress,
            self.side,
            self._rims(),
            self.quality_factor,
        )

    def _rims(self) -> tuple[Outline, ...]:
        if self.shape is None:
            return ()
        if not isinstance(self.shape, Combined):
            return (self.shape.outline(Holes(np.empty((0, 2)), 0.0)),)
        loops = []
        for region in combine(steps_of(self.shape)):
            loops += [region.outer, *region.inner]
        if not loops:
            raise GeometryError("shape: its parts leave nothing; check their operations")
        rims = [Outline("combined", loop, None, 0.0) for loop in loops]
        return tuple(Outline("combined", r.segments, None, _longest(r)) for r in rims)


Laminae = Annotated[list[LaminaTable], Field(max_length=MOST_LAYERS)]


def laminae(tables: Sequence[LaminaTable], outline: Outline) -> tuple[Lamina, ...]:
    """Return the layers of a file.

    Raises:
        GeometryError: a shape that cannot be made or that lies beside the outline, with the number
            of its table.
    """
    found = []
    for number, table in enumerate(tables, start=1):
        try:
            lamina = table.lamina()
            _refuse_beside(lamina, outline)
            found.append(lamina)
        except GeometryError as error:
            raise GeometryError(f"[layers] {number} {error}", error.point) from None
    return tuple(found)


def _refuse_beside(lamina: Lamina, outline: Outline) -> None:
    around = polygon(outline)
    if lamina.rims and not any(around.intersects(polygon(rim)) for rim in lamina.rims):
        where = lamina.rims[0].segments[0].start
        raise GeometryError(
            f"{lamina.name} lies beside the film, at {place(np.array(where))}; move its shape",
            where,
        )


def _longest(rim: Outline) -> float:
    x0, y0, x1, y1 = curves.box(rim)
    return max(x1 - x0, y1 - y0)
