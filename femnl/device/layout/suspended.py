"""From the regions of a layout's layers to the film's edge and its inner edges."""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from femnl.core.errors import GeometryError
from femnl.device.geometry import curves
from femnl.device.geometry.booleans import Operation, Region, combine
from femnl.device.geometry.naming import place
from femnl.device.geometry.openings import PER_TURN, polygon
from femnl.device.layout.drawing import Drawing, Fault, Loop, Placed
from femnl.device.layout.following import Touch
from femnl.device.layout.recognise import outline_of
from femnl.device.layout.regions import Drawn, merged

ORIGIN = np.zeros(2)


@dataclass(frozen=True)
class Film:
    """The film of a layout: its outer edge, inner edges, what was recognised, what is wrong.

    metal: the regions of a layer on it.
    """

    outer: Loop
    inner: tuple[Placed, ...]
    curves: Counter[str]
    faults: tuple[Fault, ...]
    metal: tuple[Drawn, ...] = ()


def film_of(drawing: Drawing) -> Film:
    """Return film ∩ release − frame − holes, with the posts as clamped inner edges.

    Edges of the film are clamped where neither release nor frame is drawn, and free else; those of
    release and frame are clamped, those of holes free.

    Raises:
        GeometryError: faults that forbid the use of the layout; nothing left, or several pieces.
    """
    faults = list(drawing.faults)
    counts: Counter[str] = Counter()
    regions = {}
    for role in dict.fromkeys((*drawing.polygons, *drawing.loops)):
        drawn = drawing.polygons.get(role, ())
        regions[role], found, seen = merged(drawn, drawing.grid)
        curved = [Placed(loop, ORIGIN) for loop in drawing.loops.get(role, ())]
        _refuse_nested(role, curved)
        regions[role] += [Drawn(one) for one in curved]
        counts += found
        faults += [replace(fault, what=f"{fault.what} ({role})") for fault in seen]
    _refuse(faults)
    touch = _touch(drawing)
    if touch is not None:
        del regions["frame"]
    film, inner, doubtful = _film(regions, touch)
    faults += doubtful
    posts = [region.outer for region in regions.get("posts", [])]
    metal = tuple(regions.get("metal", ()))
    return Film(film, (*inner, *posts), counts, tuple(faults), metal)


def _touch(drawing: Drawing) -> Touch | None:
    """Return where a frame touches the film, if it does no more; None where it is to be cut off."""
    film = drawing.polygons.get("film", ())
    frame = drawing.polygons.get("frame", ())
    others = [role for role in ("film", "frame", "release") if drawing.loops.get(role)]
    if len(film) == 0 or len(frame) == 0 or others or drawing.polygons.get("release"):
        return None
    touch = Touch(film, frame, drawing.grid)
    return touch if touch.decides else None


def _refuse_nested(role: str, placed: list[Placed]) -> None:
    """Refuse a curve within another of one layer, which would be lost; but for holes, in vain."""
    if role == "holes" or len(placed) < 2:
        return
    shapes = _chords(placed)
    inside, around = shapely.STRtree(shapes).query(shapes, "within")
    for one, other in zip(inside, around, strict=True):
        if one != other:
            where = place(np.array(placed[int(one)].there[0].start))
            raise GeometryError(
                f"{role}: the curve at {where} lies within another; draw what is cut out on the "
                "layer of holes"
            )


def _refuse(faults: list[Fault]) -> None:
    fatal = [fault for fault in faults if fault.fatal]
    if fatal:
        more = f" (and {len(fatal) - 1} more)" if len(fatal) > 1 else ""
        raise GeometryError(f"{fatal[0]}{more}; femnl geometry check marks them in a picture")


def _film(
    regions: dict[str, list[Drawn]], touch: Touch | None
) -> tuple[Loop, list[Placed], list[Fault]]:
    """The outer edge of what is suspended, its free inner edges, and holes that are none.

    Where the whole film is suspended, a hole off it or over its edge is a slip of whoever drew it.
    """
    release = regions.get("release", [])
    frame = regions.get("frame", [])
    held = not (release or frame)
    steps: list[tuple[Operation, Loop]] = []
    inner: list[Placed] = []
    for region in regions["film"]:
        outer = replace(region.outer, clamped=held).there
        steps.append(("add", outer if touch is None else touch.marked(outer)))
        inner += [replace(placed, clamped=False) for placed in region.inner]
    if not steps:
        raise GeometryError("film encloses no area; draw it as a closed curve")
    if release:
        steps.append(("intersect", _window(release).there))
    for region in frame:
        if region.inner:  # a ring, whose opening is where the wafer is gone
            _refuse_film_around(steps[: len(regions["film"])], region)
            steps.append(("intersect", _opening(region).there))
        else:
            steps.append(("subtract", region.outer.there))
    inner += [replace(region.outer, clamped=False) for region in regions.get("holes", [])]
    edge = steps[0][1] if len(steps) == 1 else _outer(_only(combine(steps)))
    within, across = _sorted(edge, inner)
    doubtful = []
    if held:
        kept = {id(one) for one in within}
        cutting = {id(one) for one in across}
        for one in (one for one in inner if id(one) not in kept):
            what = "hole over the edge" if id(one) in cutting else "hole off the film, left out"
            doubtful.append(Fault(what, one.there[0].start, False))
    if across:
        film = _only(combine([("add", edge), *(("subtract", p.there) for p in across)]))
        cut = [Placed(loop, ORIGIN, False) for loop in film.inner]
        edge = film.outer
        within = _sorted(edge, [*within, *cut])[0]
    return edge, within, doubtful


def _refuse_film_around(film: list[tuple[Operation, Loop]], ring: Drawn) -> None:
    """Refuse a frame with film on both sides, of which the part around it would be lost."""
    beyond = combine([*film, ("subtract", ring.outer.there)])
    if beyond:
        where = place(np.array(beyond[0].outer[0].start))
        raise GeometryError(
            f"frame: there is film around it, at {where}, and in its opening; import a cell with "
            "one of them"
        )


def _opening(ring: Drawn) -> Placed:
    """The opening of a frame that is drawn as a ring, clamped like its outer edge."""
    if len(ring.inner) > 1:
        where = place(np.array(ring.inner[-1].there[0].start))
        raise GeometryError(
            f"frame: {len(ring.inner)} openings, one at {where}; import a cell with one of them"
        )
    return replace(ring.inner[0], clamped=ring.outer.clamped)


def _outer(region: Region) -> Loop:
    """The outer edge of what is left of a film; an inner edge that comes of it is refused."""
    if region.inner:
        where = place(np.array(region.inner[0][0].start))
        raise GeometryError(
            f"film, release and frame leave an inner edge at {where}; draw it on the layer of "
            "holes, or of posts where the film is clamped there"
        )
    return region.outer


def _window(release: list[Drawn]) -> Placed:
    if len(release) > 1 or release[0].inner:
        where = place(np.array(release[-1].outer.there[0].start))
        raise GeometryError(
            f"release: {len(release)} pieces, one at {where}; give one closed curve, and posts on "
            "a layer of their own"
        )
    return release[0].outer


def _sorted(edge: Loop, placed: list[Placed]) -> tuple[list[Placed], list[Placed]]:
    """Curves within an edge, and those that meet it; those beyond it are left out."""
    if not placed:
        return [], []
    around = polygon(outline_of(edge))
    shapely.prepare(around)
    shapes = _chords(placed)
    within = shapely.contains_properly(around, shapes)
    meets = shapely.intersects(around, shapes) & ~within
    return (
        [one for one, inside in zip(placed, within, strict=True) if inside],
        [one for one, cuts in zip(placed, meets, strict=True) if cuts],
    )


def _chords(placed: list[Placed]) -> NDArray[np.object_]:
    """Polygons of curves in their places, the chords of like ones found once."""
    like = {id(one.loop): outline_of(one.loop) for one in placed}
    chords = dict(zip(like, curves.polylines(list(like.values()), PER_TURN), strict=True))
    return np.array([shapely.Polygon(chords[id(one.loop)] + one.at) for one in placed])


def _only(regions: list[Region]) -> Region:
    if not regions:
        raise GeometryError("film, release and holes leave no film; check the layers")
    if len(regions) > 1:
        sizes = [curves.area(outline_of(region.outer)) for region in regions]
        where = "; ".join(
            f"{size * 1e12:.4g} um² at {place(np.array(r.outer[0].start))}"
            for size, r in list(zip(sizes, regions, strict=True))[:4]
        )
        raise GeometryError(
            f"the film falls into {len(regions)} pieces: {where}; import a cell with one of them"
        )
    return regions[0]
