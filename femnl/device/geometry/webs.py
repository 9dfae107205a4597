"""Trampolines, dandelions and spider webs: a pad on radial tethers, with rings between them."""

from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from femnl.core.errors import GeometryError
from femnl.core.outline import Holes, Outline
from femnl.device.geometry.corners import loop, rounded
from femnl.device.geometry.polygons import Polygon
from femnl.device.geometry.quantities import Depth, Length
from femnl.device.geometry.tables import Table

Array = NDArray[np.float64]


class Suspended(Table):
    """What hangs on tethers: clamped at their ends alone, which are `span` apart."""

    span: Length
    tether: Length
    pad: Length
    fillet: Depth = 0.0

    def widened(self, width: float) -> Self:
        """Refuse: free edges have no strip of frame.

        Raises:
            GeometryError: always.
        """
        raise GeometryError(
            "[overhang] an outline with free edges has no strip of frame all around; leave "
            "[overhang] out"
        )


class Web(Suspended):
    """Radial tethers, clamped at their ends, on a pad and joined by rings of straight beams.

    span: twice the distance from the middle to the clamps. tethers: their number, the first along
    +x. tether: their width. pad: width across the sides of the polygon in the middle, which stand
    between the tethers. beams: distances from the middle at which the middle lines of the beams
    cross those of the tethers. beam: width of the beams. fillet: radius of all corners in between.
    """

    kind: Literal["web"]
    tethers: Annotated[int, Field(ge=3, le=100)]
    beams: list[Length] = Field(default_factory=list)
    beam: Length | None = None

    def outline(self, holes: Holes) -> Outline:
        """Return the outline, counter-clockwise from the tether along +x.

        Raises:
            GeometryError: a pad that its tethers cover, beams out of order or beyond the clamps,
            beams without width or width without beams, fillets longer than an edge.
        """
        outermost = self._edges()[-1]
        end = np.array([[self.span / 2, -self.tether / 2], [self.span / 2, self.tether / 2]])
        points: list[list[float]] = []
        for k in range(self.tethers):
            points += _turned(end, k * self._angle).tolist()
            points += self._across(k, outermost).tolist()
        # Of numbers in metres, which a file would give with their unit
        polygon = Polygon.model_construct(
            kind="polygon",
            points=points,
            # Of each four edges the first is a clamp
            free=[edge + 1 for edge in range(len(points)) if edge % 4],
            arcs=[],
            fillet=self.tethers * [0.0, 0.0, self.fillet, self.fillet],
        )
        return Outline(self.kind, polygon.outline(holes).segments, None, self.span)

    def windows(self) -> tuple[Outline, ...]:
        """Return the openings between tethers, pad and beams, each walked counter-clockwise."""
        edges = self._edges()
        found: list[Outline] = []
        for inner, outer in zip(edges[:-1:2], edges[1::2], strict=True):
            for k in range(self.tethers):
                near = self._across(k, inner)
                far = self._across(k, outer)
                corners = np.array([near[1], near[0], far[0], far[1]])
                names = [f"window {len(found) + 1}, corner {j + 1}" for j in range(4)]
                rim = rounded(loop(corners, False), np.full(4, self.fillet), names)
                found.append(Outline("window", rim, None, float(np.ptp(corners, axis=0).max())))
        return tuple(found)

    @property
    def _angle(self) -> float:
        """Between neighbouring tethers [rad]."""
        return 2 * np.pi / self.tethers

    def _edges(self) -> list[float]:
        """Distances [m] of the free edges across a sector from the middle: pad, then each beam."""
        if bool(self.beams) != (self.beam is not None):
            raise GeometryError(
                "[outline] beams and beam belong together: the distances of the beams and their "
                "width; give both or none"
            )
        half = (self.beam or 0.0) / 2
        edges = [self.pad / 2]
        for at in self.beams:
            middle = at * float(np.cos(self._angle / 2))
            if middle - half <= edges[-1]:
                raise GeometryError(
                    f"[outline] beams = {at * 1e6:.4g} um: it lies on the pad or on the beam "
                    "before; give beams from the inside out, with a window between them"
                )
            edges += [middle - half, middle + half]
        if self._half_width(edges[0]) <= 0:
            raise GeometryError(
                f"[outline] pad = {self.pad * 1e6:.4g} um: {self.tethers} tethers of "
                f"{self.tether * 1e6:.4g} um cover it; raise pad or narrow the tethers"
            )
        if self._across(0, edges[-1])[0, 0] >= self.span / 2:
            last = self.beams[-1] if self.beams else self.pad
            what = f"{'beams' if self.beams else 'pad'} = {last * 1e6:.4g}"
            raise GeometryError(
                f"[outline] {what} um: it reaches beyond the tethers' ends; lower it or raise span"
            )
        return edges

    def _half_width(self, distance: float) -> float:
        """Half of what two tethers leave free across their sector at a distance [m]."""
        half = self._angle / 2
        return float(distance * np.tan(half) - self.tether / 2 / np.cos(half))

    def _across(self, sector: int, distance: float) -> Array:
        """Where an edge across a sector meets its two tethers (2, 2) [m], counter-clockwise."""
        wide = self._half_width(distance)
        ends = np.array([[distance, -wide], [distance, wide]])
        return _turned(ends, (sector + 0.5) * self._angle)


class Trampoline(Suspended):
    """A square pad on four tethers along x and y that leave from its corners.

    span: from one clamp to the opposite one. tether: width of the tethers. pad: side of the pad.
    fillet: radius of the corners between tethers and pad.
    """

    kind: Literal["trampoline"]

    def outline(self, holes: Holes) -> Outline:
        """Return the outline, counter-clockwise from the tether along +x.

        Raises:
            GeometryError: as of `Web`; a trampoline is one of four tethers without beams.
        """
        web = Web.model_construct(
            kind="web",
            span=self.span,
            tethers=4,
            beams=[],
            beam=None,
            tether=self.tether,
            pad=self.pad,
            fillet=self.fillet,
        )
        return Outline(self.kind, web.outline(holes).segments, None, self.span)


def _turned(points: Array, angle: float) -> Array:
    c = np.cos(angle)
    s = np.sin(angle)
    return np.asarray(points @ np.array([[c, s], [-s, c]]))
