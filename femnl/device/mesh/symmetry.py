"""Mirror symmetry of a device and the wedge of it that suffices."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from femnl.core.choices import check_symmetry
from femnl.core.device import Model
from femnl.core.errors import ParameterError
from femnl.core.outline import Outline
from femnl.device.geometry import curves
from femnl.device.geometry.placing import moved

Array = NDArray[np.float64]

FULL = 2 * np.pi
HALF = np.pi
QUARTER = np.pi / 2
EIGHTH = np.pi / 4
TWELFTH = np.pi / 6
GRID_STEPS = 1.5
"""Steps of the drawing's grid up to which two points are images of each other: both are rounded to
it, by up to 0.71 of a step."""
CENTRED = 1e-9
"""Of the film's length, by which its middle may miss the origin by rounding."""
ALONG = 12
MOST_ALONG = 100_000
"""Points along each piece of a layer's rim whose mirror images are looked for on its rims, at least
and at most; there are at least twice as many in the length of the film.
"""
WEDGES = {"full": FULL, "half": HALF, "quarter": QUARTER, "eighth": EIGHTH, "twelfth": TWELFTH}


def find_wedge(model: Model, symmetry: str) -> float:
    """Return the angle [rad] of the wedge that a word for the symmetry asks for.

    `auto` takes the smallest of quarter, half and full.

    Raises: ParameterError where there is no such word, or where the device lacks that symmetry.
    """
    if symmetry == "auto":
        return next(
            WEDGES[name]
            for name in ("quarter", "half", "full")
            if has_symmetry(model, WEDGES[name])
        )
    check_symmetry(symmetry)
    if not has_symmetry(model, WEDGES[symmetry]):
        raise ParameterError(
            f'symmetry = "{symmetry}": outline and holes of {model.name} do not have it; use '
            "auto or full"
        )
    return WEDGES[symmetry]


def film_middle(model: Model) -> Array:
    """Return the middle (2,) [m] of the box around a film, through which its mirror lines run.

    Exactly 0 where the film lies about the origin to rounding.
    """
    x0, y0, x1, y1 = curves.box(model.edge_outline)
    middle = np.array([x0 + x1, y0 + y1]) / 2
    return np.where(np.abs(middle) < CENTRED * model.outline.length, 0.0, middle)


def has_symmetry(model: Model, wedge: float) -> bool:
    """Return whether the device maps onto itself under its mirror lines.

    Through its middle, at angle 0 and, for wedges below π, at `wedge`.
    """
    if wedge == FULL:
        return True
    angles = (0.0,) if wedge == HALF else (0.0, wedge)
    tolerance = max(1e-6 * model.outline.length, GRID_STEPS * model.grid)
    middle = film_middle(model)
    if middle.any():
        model = moved(model, -middle)
    points = [_key_points(model.outline), model.holes.centres, _opening_points(model)]
    points += [] if model.overhang is None else [_key_points(model.overhang.outline)]
    # A slope of the thickness is its own image where the film's thickness is everywhere, to the
    # same part.
    slope = np.array([model.film.gradient]) * model.outline.length**2 / model.film.thickness
    drawn = all(_is_mirrored(p, a, tolerance) for p in points for a in angles)
    drawn = drawn and all(_mirrors_layers(model, a, tolerance) for a in angles)
    return drawn and all(_is_mirrored(slope, a, 1e-6 * model.outline.length) for a in angles)


def beyond_mirrors(points: Array, wedge: float) -> Array:
    """How far points (n, 2) lie beyond the mirror lines of a wedge; negative inside."""
    x, y = points.T
    beyond = np.full(len(points), -np.inf)
    if wedge < FULL:
        beyond = np.maximum(beyond, -y)
    if wedge < HALF:
        beyond = np.maximum(beyond, y * np.cos(wedge) - x * np.sin(wedge))
    return beyond


def _key_points(outline: Outline) -> Array:
    """Points that pin down an outline.

    For each segment its two ends, centre and middle, the clamped ones offset in z.
    """
    rows = []
    for s in outline.segments:
        middle = curves.point_at(s, 0.5)
        rows += [(*s.start, 1.0), (*middle, 2.0 + s.clamped)]
    points = np.array(rows)
    points[:, 2] *= outline.length
    return points


def _opening_points(model: Model) -> Array:
    """Points that pin down the openings: middles of circles, key points of all others.

    Offset in z by size and by what is clamped.
    """
    rows = [np.empty((0, 3))]
    for opening in model.openings:
        if opening.kind == "circle":
            x, y = opening.segments[0].centre or (0.0, 0.0)
            points = np.array([[x, y, model.outline.length]])
        else:
            points = _key_points(opening)
        clamped = opening.segments[0].clamped
        points[:, 2] += opening.length + 10 * clamped * model.outline.length
        rows.append(points)
    return np.concatenate(rows)


def _mirrors_layers(model: Model, angle: float, tolerance: float) -> bool:
    """Whether the image of each layer's rims lies on its rims, as far as they lie on the film."""
    ends = np.linspace(0, 1, ALONG)
    step = model.outline.length / (2 * ALONG)
    for lamina in model.layers:
        segments = [segment for rim in lamina.rims for segment in rim.segments]
        if not segments:
            continue
        rough = [curves.point_at(segment, ends) for segment in segments]
        lengths = [np.hypot(*np.diff(one, axis=0).T).sum() for one in rough]
        # A rim that reaches far beyond the film is looked at as closely where it crosses it
        counts = [min(max(ALONG, int(length / step)), MOST_ALONG) for length in lengths]
        points = np.concatenate(
            [
                curves.point_at(segment, np.linspace(0, 1, count))
                for segment, count in zip(segments, counts, strict=True)
            ]
        )
        inside = curves.contains(model.edge_outline, points)
        inside &= curves.distance(model.edge_outline, points) > tolerance
        image = points[inside] @ _mirror(angle)
        away = np.min([curves.distance(rim, image) for rim in lamina.rims], axis=0)
        if np.any(away > tolerance):
            return False
    return True


def _mirror(angle: float) -> Array:
    """Return the mirror image (2, 2) about a line through the origin at an angle."""
    c = np.cos(2 * angle)
    s = np.sin(2 * angle)
    return np.array([[c, s], [s, -c]])


def _is_mirrored(points: Array, angle: float, tolerance: float) -> bool:
    if len(points) == 0:
        return True
    image = points.copy()
    image[:, :2] = points[:, :2] @ _mirror(angle)
    return bool(np.all(cKDTree(points).query(image)[0] < tolerance))
