"""The layers of one cell: what of a layer's shape repeats with the lattice of a device."""

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.affinity import translate

from femnl.core.device import Lamina, Model
from femnl.core.errors import ParameterError
from femnl.core.outline import Outline
from femnl.device.geometry import curves
from femnl.device.geometry.openings import polygon
from femnl.device.geometry.placing import placed
from femnl.device.mesh import film_middle
from femnl.mechanics.bands.lattice import Lattice

Array = NDArray[np.float64]

ALIKE = 1e-3
"""Of a cell's area, by which a layer may differ from cell to cell: coordinates of layouts are
rounded to a nanometre, and curves are compared as polygons."""


@dataclass(frozen=True)
class Frame:
    """How a device lies on its lattice: turned by −angle [rad], then moved by −origin (2,) [m].

    Then a row of the lattice runs along x, and the origin is the middle of a cell.
    """

    lattice: Lattice
    angle: float
    origin: Array

    def of(self, outline: Outline) -> Outline:
        """Return an outline of the device in this frame."""
        return placed(placed(outline, (0.0, 0.0), -self.angle), -self.origin)

    def about(self, origin: Array) -> "Frame":
        """Return the frame about that equivalent of an origin that is nearest to this one's.

        Args: origin (2,) [m]: of the turned device.
        """
        steps = self.lattice.steps[:2]
        number = np.round(np.linalg.solve(steps.T, self.origin - origin))
        return replace(self, origin=origin + number @ steps)


def film_frame(model: Model, lattice: Lattice, angle: float) -> Frame:
    """Return the frame about the middle of the film."""
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return Frame(lattice, angle, turn @ film_middle(model))


def cell_layers(model: Model, frame: Frame) -> tuple[Lamina, ...]:
    """Return the layers with those of their rims that lie around or in the cell of a frame."""
    cell = shapely.Polygon(frame.lattice.corners)
    found = []
    for lamina in model.layers:
        rims = []
        for rim in lamina.rims:
            own = frame.of(rim)
            # Boxes first, as a layer may have a rim in each of a thousand cells
            near = shapely.box(*curves.box(own)).intersects(cell)
            if near and polygon(own).intersects(cell):
                # Elements follow the parts of a rim that lie in one cell
                rims.append(replace(own, length=min(own.length, frame.lattice.pitch)))
        if rims or not lamina.rims:
            found.append(replace(lamina, rims=tuple(rims)))
    return tuple(found)


def need_repeating(model: Model, frame: Frame, region: shapely.Geometry, single: bool) -> None:
    """Refuse layers that do not cover the same part of every cell.

    Compared are all cells that lie wholly in a region, or, where the cell of the frame is the only
    one, the parts of all others that lie in it.

    Args: region: the film, or what its holes span, in the frame. single: whether a layer may lie in
        the cell of the frame alone, which then stands for all cells, as the one hole of a device
        does where its lattice is given.

    Raises: ParameterError naming the layer.
    """
    places, cells = _cells_on(region, frame.lattice)
    whole = shapely.covers(region.buffer(ALIKE * frame.lattice.pitch), cells)
    compared = whole if whole.sum() > 1 else ~whole
    places = places[compared]
    parts = shapely.intersection(cells[compared], region)
    own = shapely.Polygon(frame.lattice.corners)
    for number, lamina in enumerate(model.layers, start=1):
        if not lamina.rims:
            continue
        drawn = _region(lamina, frame)
        if single and drawn.difference(own).area < ALIKE * own.area:
            continue
        pattern = drawn.intersection(own)
        expected = np.array([translate(pattern, *place) for place in places])
        covered = shapely.intersection(drawn, parts)
        differs = shapely.symmetric_difference(covered, shapely.intersection(expected, parts))
        if np.any(shapely.area(differs) > ALIKE * own.area):
            raise ParameterError(
                f"{model.name}: [layers] {number} {lamina.name}: does not repeat with the "
                f"{frame.lattice.kind} lattice of pitch {frame.lattice.pitch * 1e6:.5g} µm; "
                "bands need the same shape in every cell"
            )


def _region(lamina: Lamina, frame: Frame) -> shapely.Geometry:
    """Return what an odd number of a layer's rims goes around, in a frame."""
    rings = [polygon(frame.of(rim)).exterior for rim in lamina.rims]
    return shapely.build_area(shapely.MultiLineString(rings))


def _cells_on(region: shapely.Geometry, lattice: Lattice) -> tuple[Array, NDArray[np.object_]]:
    """Return places (n, 2) [m] of the cells that a region reaches into, and the cells (n,)."""
    x0, y0, x1, y1 = region.bounds
    reach = float(np.hypot(max(-x0, x1), max(-y0, y1)))
    number = int(np.ceil(2 * reach / lattice.pitch)) + 1
    first, second = np.meshgrid(*2 * [np.arange(-number, number + 1)])
    places = np.stack([first.ravel(), second.ravel()], axis=1) @ lattice.steps[:2]
    cells = shapely.polygons(places[:, None] + lattice.corners)
    on = shapely.intersects(region, cells)
    return places[on], cells[on]
