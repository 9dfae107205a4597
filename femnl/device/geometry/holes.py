"""Release holes: lattices and lists of centres, and whether they leave a film between them."""

from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, model_validator

from femnl.core.errors import GeometryError
from femnl.core.outline import Holes, Outline
from femnl.device.geometry.combined import Combined
from femnl.device.geometry.hole_faults import TOUCHING
from femnl.device.geometry.placing import held, placed
from femnl.device.geometry.polygons import Polygon
from femnl.device.geometry.quantities import Angle, Depth, Length, Position, Radii, refusal
from femnl.device.geometry.shapes import Rectangle, RegularPolygon, Spline, Square, ellipse
from femnl.device.geometry.tables import Table

Array = NDArray[np.float64]

MOST = 100_000
"""More holes than this are taken for a mistake."""

HoleShape = Annotated[
    Square | Rectangle | RegularPolygon | Polygon | Spline | Combined, Field(discriminator="kind")
]
Count = Annotated[int, Field(ge=1, le=MOST)]


class Group(Table):
    """What groups of holes share: their shape, and whether their rims are held.

    radius: of round holes. semi_axes: half the axes of elliptical ones. shape: any other shape,
    whose origin comes to lie at each centre. angle: from x to the first of semi_axes, or to the x
    axis of the shape. clamped: whether the film is held at the rims, as on posts; else it ends
    free.
    """

    radius: Radii | None = None
    semi_axes: Annotated[list[Length], Field(min_length=2, max_length=2)] | None = None
    shape: HoleShape | None = None
    angle: Angle = 0.0
    clamped: bool = False

    @model_validator(mode="after")
    def _has_one_shape(self) -> Self:
        given = [self.radius is not None, self.semi_axes is not None, self.shape is not None]
        if sum(given) != 1:
            raise refusal(
                'give either radius = "0.9 um" (round holes), semi_axes = ["4 um", "2 um"] '
                "(elliptical ones) or a table shape (any others), one of them"
            )
        if self.angle != 0 and self.radius is not None:
            raise refusal("round holes have no direction; leave angle out", "angle")
        if isinstance(self.shape, Polygon | Combined) and self.shape.free:
            raise refusal("a hole's rim ends free unless clamped = true; leave free out", "shape")
        return self

    @property
    def alike(self) -> bool:
        """Whether the holes are round, of one radius, and free: those of `Model.holes`."""
        return isinstance(self.radius, float) and not self.clamped

    def prototypes(self, number: int) -> tuple[list[Outline], NDArray[np.int64]]:
        """Return the different rims about the origin, and which of them each hole (n,) has."""
        which = np.zeros(number, dtype=np.int64)
        if self.shape is not None:
            made = self.shape.outline(Holes(np.empty((0, 2)), 0.0))
            return [placed(held(made, self.clamped), (0.0, 0.0), self.angle)], which
        axes = np.zeros((1, 2))
        if self.semi_axes is not None:
            axes = np.array([self.semi_axes])
        elif self.radius is not None:
            radii, which = np.unique(np.broadcast_to(self.radius, number), return_inverse=True)
            axes = np.stack([radii, radii], axis=1)
        found = []
        for a, b in axes.tolist():
            rim = ellipse((0.0, 0.0), (a, b), self.angle, self.clamped)
            found.append(Outline("circle" if a == b else "ellipse", rim, None, 2 * max(a, b)))
        return found, which


class Lattice(Group):
    """What regular lattices share. Their middle lies at the origin, or at `offset` from it.

    defect: distance from the middle within which holes are left out.
    """

    pitch: Length
    radius: Length | None = None
    offset: Position = Field(default_factory=lambda: [0.0, 0.0])
    defect: Depth = 0.0

    def around_defect(self, places: Array) -> Array:
        """Return the places (n, 2) [m] about the middle that no defect takes, moved by `offset`."""
        kept = places[np.hypot(*places.T) > self.defect] if self.defect > 0 else places
        return kept + self.offset

    @model_validator(mode="after")
    def _leaves_film_between_holes(self) -> Self:
        if self.radius is not None and self.pitch <= 2 * self.radius * (1 + TOUCHING):
            raise refusal(
                "holes overlap or touch, the pitch must exceed twice their radius; raise pitch "
                "or lower radius",
                "pitch",
            )
        return self


class SquareLattice(Lattice):
    """nx × ny holes in rows and columns."""

    lattice: Literal["square"]
    count: Annotated[list[Count], Field(min_length=2, max_length=2)]

    def positions(self) -> Array:
        """Return the centres (n, 2) [m], row by row from the lower left."""
        nx, ny = self.count
        _refuse_too_many(nx * ny, f"count = [{nx}, {ny}]")
        x, y = (self.pitch * (np.arange(n) - (n - 1) / 2) for n in (nx, ny))
        return self.around_defect(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))


class RectangularLattice(Group):
    """nx × ny holes in columns and rows at two pitches. Their middle lies at `offset`."""

    lattice: Literal["rectangular"]
    pitch: Annotated[list[Length], Field(min_length=2, max_length=2)]
    radius: Length | None = None
    offset: Position = Field(default_factory=lambda: [0.0, 0.0])
    count: Annotated[list[Count], Field(min_length=2, max_length=2)]

    def positions(self) -> Array:
        """Return the centres (n, 2) [m], row by row from the lower left."""
        nx, ny = self.count
        _refuse_too_many(nx * ny, f"count = [{nx}, {ny}]")
        x = self.pitch[0] * (np.arange(nx) - (nx - 1) / 2)
        y = self.pitch[1] * (np.arange(ny) - (ny - 1) / 2)
        return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) + self.offset


class HexagonalLattice(Lattice):
    """Every hole has six nearest neighbours, two of them along x.

    Either `rings`: a hexagon of that many rings around a middle hole, its corners along x as those
    of a hexagonal outline; or `count`: ny rows of nx holes, every second row shifted by half a
    pitch.
    """

    lattice: Literal["hexagonal"]
    rings: Annotated[int, Field(ge=0, le=MOST)] | None = None
    count: Annotated[list[Count], Field(min_length=2, max_length=2)] | None = None

    @model_validator(mode="after")
    def _has_one_extent(self) -> Self:
        if (self.rings is None) == (self.count is None):
            raise refusal(
                "give either rings = 15 (a hexagon) or count = [30, 30] (rows), not both, "
                "not neither"
            )
        return self

    def positions(self) -> Array:
        """Return the centres (n, 2) [m], row by row from below."""
        if self.rings is not None:
            _refuse_too_many(1 + 3 * self.rings * (self.rings + 1), f"rings = {self.rings}")
            q, r = np.meshgrid(*2 * [np.arange(-self.rings, self.rings + 1)])
            inside = np.abs(q + r) <= self.rings
            x = (q + r / 2)[inside]
            y = r[inside]
        else:
            nx, ny = self.count or (0, 0)
            _refuse_too_many(nx * ny, f"count = [{nx}, {ny}]")
            column, row = np.meshgrid(np.arange(nx), np.arange(ny))
            x = (column + row % 2 / 2).ravel()
            y = row.ravel()
            x = x - (x.min() + x.max()) / 2
            y = y - (ny - 1) / 2
        return self.around_defect(self.pitch * np.stack([x, y * np.sqrt(3) / 2], axis=-1))


class Honeycomb(Lattice):
    """Two holes a cell, at a third and two thirds of its long diagonal, none in the middle.

    pitch: of the cells, √3 times the distance between neighbouring holes. count: nx columns and ny
    rows of cells around the middle, of which holes of the cells at the rim may be halved.
    """

    lattice: Literal["honeycomb"]
    count: Annotated[list[Count], Field(min_length=2, max_length=2)]

    @model_validator(mode="after")
    def _leaves_film_between_neighbours(self) -> Self:
        if self.radius is not None and self.pitch <= 2 * np.sqrt(3) * self.radius * (1 + TOUCHING):
            raise refusal(
                "holes overlap or touch, the pitch of a honeycomb must exceed 2√3 times their "
                "radius; raise pitch or lower radius",
                "pitch",
            )
        return self

    def positions(self) -> Array:
        """Return the centres (n, 2) [m], row by row from below."""
        nx, ny = self.count
        _refuse_too_many(2 * nx * ny, f"count = [{nx}, {ny}]")
        i, j = np.meshgrid(np.arange(-nx - ny, nx + ny + 1), np.arange(-ny, ny + 1))
        cells = np.stack([(i + j / 2).ravel(), (j * np.sqrt(3) / 2).ravel()], axis=1)
        third = np.array([0.0, 1 / np.sqrt(3)])
        every = np.concatenate([cells + third, cells - third])
        x, y = np.abs(every).T
        within = every[(x <= nx / 2 + TOUCHING) & (y <= ny * np.sqrt(3) / 4 + TOUCHING)]
        order = np.lexsort(np.round(within.T, 9))
        return self.around_defect(self.pitch * within[order])


class Ring(Group):
    """Holes evenly around a circle, the first along +x, such as the petals around a pad.

    distance: of their centres from the middle of the ring. angle: from the ray through a hole's
    centre to the first of semi_axes, or to the x axis of the shape.
    """

    lattice: Literal["ring"]
    count: Count
    distance: Length
    radius: Length | None = None
    offset: Position = Field(default_factory=lambda: [0.0, 0.0])

    def positions(self) -> Array:
        """Return the centres (n, 2) [m], counter-clockwise."""
        turn = self._turns()
        ring = self.distance * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        return np.asarray(ring + self.offset)

    def prototypes(self, number: int) -> tuple[list[Outline], NDArray[np.int64]]:
        """Return a rim about the origin for each hole, turned with its ray."""
        (first,), _ = super().prototypes(number)
        return [placed(first, (0.0, 0.0), turn) for turn in self._turns()], np.arange(number)

    def _turns(self) -> Array:
        return 2 * np.pi * np.arange(self.count) / self.count


class HoleList(Group):
    """Holes wherever the file says, each of its own radius where `radius` is a list."""

    lattice: Literal["list"]
    centres: Annotated[list[Position], Field(min_length=1, max_length=MOST)]

    @model_validator(mode="after")
    def _has_a_radius_for_each(self) -> Self:
        if isinstance(self.radius, list) and len(self.radius) != len(self.centres):
            raise refusal(
                f"{len(self.radius)} radii for {len(self.centres)} centres; give one a centre, or "
                "one for all",
                "radius",
            )
        return self

    def positions(self) -> Array:
        """Return the centres (n, 2) [m], in the order of the file."""
        return np.array(self.centres)


HolesTable = Annotated[
    SquareLattice | RectangularLattice | HexagonalLattice | Honeycomb | Ring | HoleList,
    Field(discriminator="lattice"),
]


def _as_groups(value: Any) -> Any:
    """Return [holes], which is one group, as [[holes]] would write it."""
    return value if isinstance(value, list) else [value]


HoleGroups = Annotated[
    list[HolesTable], BeforeValidator(_as_groups), Field(min_length=1, max_length=MOST)
]


def _refuse_too_many(number: int, cause: str) -> None:
    if number > MOST:
        raise GeometryError(f"[holes] {cause}: {number} holes, expected at most {MOST}")
