"""SVG through svgpathtools."""

import logging
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import svgpathtools
from numpy.typing import NDArray

from femnl.core.errors import GeometryError, one_line
from femnl.core.outline import Segment
from femnl.device.geometry.quantities import LENGTH, to_si
from femnl.device.geometry.splines import arcs_along
from femnl.device.layout.chains import GRID, closed
from femnl.device.layout.drawing import Drawing, Loop

Array = NDArray[np.float64]

PHYSICAL = ("mm", "cm", "in")
UNREAD = frozenset({"use", "svg", "a", "image", "text", "switch", "symbol"})
"""Elements that show something and are no shape; clones are <use>."""
DISPLAY = re.compile(r"(?:^|;)\s*display\s*:\s*(\w+)")
"""What a style says of whether an element is shown."""
LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
WITHIN = GRID  # m, how far arcs may leave a Bézier curve
ROUND = 1e-9  # relative difference up to which two half axes are one radius


def read(path: Path, cell: str | None, layers: Mapping[str, str], unit: str | None) -> Drawing:
    """Read the paths and shapes of groups by id or label; see `readers.read_drawing`."""
    if cell is not None:
        raise GeometryError(one_line(f"{path}: an SVG file has no cells; leave --cell out"))
    try:
        document = svgpathtools.Document(str(path))
        found = document.paths()
    except (ValueError, AttributeError, IndexError) as error:
        raise GeometryError(
            one_line(f"{path}: a shape is not read: {error}; give plain numbers, without units")
        ) from error
    except (OSError, ElementTree.ParseError) as error:
        raise GeometryError(one_line(f"{path}: not a whole SVG file; export it again")) from error
    root: Any = document.tree.getroot()
    size = _unit(path, root, unit)
    parents = {child: parent for parent in root.iter() for child in parent}
    polygons = {}
    loops = {}
    faults = []
    for role, layer in layers.items():
        _refuse_unread(path, root, layer, parents)
        within = [drawn for drawn in found if layer in _names(drawn.element, parents)]
        shown = [drawn for drawn in within if not _hidden(drawn.element, parents)]
        _tell_what_is_hidden(path, f"group {layer} ({role})", len(within), len(shown))
        pieces = [_chain(part, size) for drawn in shown for part in drawn.continuous_subpaths()]
        if not pieces:
            known = sorted({name for drawn in found for name in _names(drawn.element, parents)})
            raise GeometryError(
                one_line(
                    f"{path}: group {layer} ({role}) is empty; expected one of {', '.join(known)}"
                )
            )
        polygons[role], loops[role], seen = closed(pieces, f"group {layer} ({role})")
        faults += seen
    return Drawing(path.stem, GRID, polygons, loops, tuple(faults))


def _unit(path: Path, root: Any, unit: str | None) -> float:
    """The length [m] of a user unit: width over that of viewBox, where width has a unit.

    Raises: GeometryError where the height says another length.
    """
    match = re.fullmatch(r"\s*([\d.eE+-]+)\s*(\w+)\s*", root.get("width", ""))
    box = root.get("viewBox", "").replace(",", " ").split()
    known = match is not None and match[2] in PHYSICAL and len(box) == 4
    if known and unit is not None:
        raise GeometryError(one_line(f"{path}: this file names its unit; leave --unit out"))
    if match is not None and known:
        return _of_box(path, root, to_si(f"{match[1]} {match[2]}", LENGTH), box)
    if unit is None:
        raise GeometryError(
            one_line(f"{path}: names no unit of length; give one, such as --unit um")
        )
    return to_si(f"1 {unit}", LENGTH)


def _of_box(path: Path, root: Any, width: float, box: list[str]) -> float:
    """The length [m] of a user unit of a box that is `width` wide."""
    try:
        across, down = (float(side) for side in box[2:])
    except ValueError:
        across = down = 0.0
    if not (0 < across < np.inf and 0 < down < np.inf):
        raise GeometryError(
            one_line(f"{path}: viewBox = {' '.join(box)}: expected a positive width and height")
        )
    size = width / across
    match = re.fullmatch(r"\s*([\d.eE+-]+)\s*(\w+)\s*", root.get("height", ""))
    if match is not None and match[2] in PHYSICAL:
        other = to_si(f"{match[1]} {match[2]}", LENGTH) / down
        if abs(other - size) > 1e-3 * size:
            raise GeometryError(
                one_line(
                    f"{path}: a unit is {size:.4g} m by its width and {other:.4g} m by its height; "
                    "save it with a viewBox of the same shape"
                )
            )
    return size


def _names(element: Any, parents: Mapping[Any, Any]) -> set[str]:
    """The ids and labels of an element and of the groups around it."""
    found = set()
    here = element
    while here is not None:
        found |= {name for name in (here.get("id"), here.get(LABEL)) if name}
        here = parents.get(here)
    return found


def _hidden(element: Any, parents: Mapping[Any, Any]) -> bool:
    """Whether an element, or a group around it, is not displayed."""
    here = element
    while here is not None:
        styles = [here.get("display", ""), *DISPLAY.findall(here.get("style", ""))]
        if styles[-1].strip() == "none":  # a style outweighs an attribute
            return True
        here = parents.get(here)
    return False


def _tell_what_is_hidden(path: Path, group: str, count: int, shown: int) -> None:
    """Warn of shapes that are left out as they are hidden; refuse a group that is hidden whole."""
    if count and not shown:
        raise GeometryError(
            one_line(f"{path}: {group} is hidden (display: none); show it and save the file again")
        )
    if shown < count:
        logging.getLogger("femnl").warning(
            "%s: %s: hidden shapes (%d) are left out", path, group, count - shown
        )


def _refuse_unread(path: Path, root: Any, layer: str, parents: Mapping[Any, Any]) -> None:
    """Refuse elements of a group that would be passed over, or read in another place."""
    for element in root.iter():
        if not isinstance(element.tag, str) or layer not in _names(element, parents):
            continue
        if _hidden(element, parents):
            continue
        kind = element.tag.rpartition("}")[2]
        if kind in UNREAD and element is not root:
            raise GeometryError(
                one_line(f"{path}: group {layer}: <{kind}> is not read; make it a path of its own")
            )
        if "transform" in element.get("style", ""):
            raise GeometryError(
                one_line(
                    f"{path}: group {layer}: a transform within style is not read; write it as the "
                    "attribute transform"
                )
            )


def _chain(part: Any, size: float) -> Loop:
    """A path as lines and arcs [m], y upwards."""
    pieces: list[Segment] = []
    for piece in part:
        pieces += _segments(piece, size)
    return tuple(pieces)


def _segments(piece: Any, size: float) -> list[Segment]:
    start = _at(piece.start, size)
    end = _at(piece.end, size)
    if isinstance(piece, svgpathtools.Line):
        return [Segment(_pair(start), _pair(end))] if np.hypot(*(end - start)) > 0 else []
    if isinstance(piece, svgpathtools.Arc):
        radius = piece.radius
        if abs(radius.real - radius.imag) <= ROUND * radius.real:
            # What turns clockwise in SVG, whose y points down, does so upright as well
            middle = _pair(_at(piece.center, size))
            clockwise = piece.delta > 0
            return [Segment(_pair(start), _pair(end), middle, clockwise=clockwise)]

    def curve(place: float) -> tuple[Array, Array]:
        along = _at(piece.derivative(place), size)
        return _at(piece.point(place), size), along / np.hypot(*along)

    return arcs_along(curve, 0.0, 1.0, WITHIN)


def _at(point: complex, size: float) -> Array:
    return np.array([point.real, -point.imag]) * size


def _pair(point: Array) -> tuple[float, float]:
    return float(point[0]), float(point[1])
