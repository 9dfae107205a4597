"""The tables of the film and of its edge: springs, and an undercut strip of the frame."""

from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from femnl.core.device import Clamp, Film, Overhang
from femnl.core.errors import GeometryError
from femnl.core.outline import Holes, Outline
from femnl.device.geometry import curves
from femnl.device.geometry.outlines import OutlineTable
from femnl.device.geometry.quantities import (
    Coordinate,
    Density,
    Depth,
    Length,
    LooseSpring,
    Pressure,
    Slope,
    Spring,
    Torsion,
    refusal,
)
from femnl.device.geometry.tables import Table

Poisson = Annotated[float, Field(ge=0, lt=0.5)]
FLAT = (0.0, 0.0)


class FilmTable(Table):
    """The film; see types.device.Film for taper and gradient."""

    thickness: Length
    young: Pressure
    poisson: Poisson
    density: Density
    stress: Pressure
    taper: Depth = 0.0
    taper_length: Length | None = None
    gradient: Annotated[list[Slope], Field(min_length=2, max_length=2)] | None = None

    @model_validator(mode="after")
    def _has_a_whole_taper(self) -> Self:
        if self.taper >= self.thickness:
            raise refusal(
                "expected less than the thickness of the film, or nothing is left at a hole's rim",
                "taper",
            )
        if self.taper > 0 and self.taper_length is None:
            raise refusal('a taper needs its length, write e.g. taper_length = "4 um"', "taper")
        if self.taper == 0 and self.taper_length is not None:
            raise refusal(
                'there is no taper; write e.g. taper = "60 nm" or leave taper_length out',
                "taper_length",
            )
        return self

    def film(self, outline: Outline) -> Film:
        """Return the film in SI units.

        Raises:
            GeometryError: a gradient that leaves no film somewhere within the outline.
        """
        x, y = self.gradient or FLAT
        x0, y0, x1, y1 = curves.box(outline)
        least = self.thickness - self.taper + min(x * x0, x * x1) + min(y * y0, y * y1)
        if least <= 0:
            raise GeometryError(
                f"[film] gradient = [{x:.4g}, {y:.4g}]: nothing is left of the film at a corner "
                f"of its box; lower gradient{' or taper' if self.taper else ''}"
            )
        return Film(
            self.thickness,
            self.young,
            self.poisson,
            self.density,
            self.stress,
            self.taper,
            self.taper_length or 0.0,
            (x + 0.0, y + 0.0),
        )


class ClampTable(Table):
    """What of the edge gives way, as springs per length; what is left out is rigid.

    See types.device.Clamp.
    """

    deflection: Spring | None = None
    rotation: Torsion | None = None
    normal: Spring | None = None
    shear: LooseSpring | None = None
    draw: Coordinate = 0.0

    @model_validator(mode="after")
    def _draws_with_springs(self) -> Self:
        if self.draw != 0 and self.normal is None:
            raise refusal('it needs springs that draw, write e.g. normal = "20 GPa"', "draw")
        return self

    def clamp(self) -> Clamp:
        """Return the springs, infinite where the edge is rigid."""
        springs = (self.deflection, self.rotation, self.normal, self.shear)
        deflection, rotation, normal, shear = (np.inf if k is None else k for k in springs)
        return Clamp(deflection, rotation, normal, shear, self.draw)


class OverhangTable(Table):
    """An undercut strip of the frame all around the outline, `width` wide.

    Of the film, where nothing else is said, and not tapered.
    """

    width: Length
    thickness: Length | None = None
    young: Pressure | None = None
    poisson: Poisson | None = None
    density: Density | None = None
    stress: Pressure | None = None

    def overhang(self, outline: OutlineTable, holes: Holes, film: FilmTable) -> Overhang:
        """Return the strip between the outline and its outer rim.

        The sides of the rim are the outline's, `width` further out.

        Raises:
            GeometryError: an outline around which there is no such strip.
        """
        own = {
            key: value
            for key, value in self.model_dump(exclude={"width"}).items()
            if value is not None
        }
        made = Film(
            **(
                {
                    key: getattr(film, key)
                    for key in ("thickness", "young", "poisson", "density", "stress")
                }
                | own
            )
        )
        return Overhang(self.width, outline.widened(self.width).outline(holes), made)
