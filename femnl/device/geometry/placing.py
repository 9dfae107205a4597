"""Outlines and devices moved and turned in the plane."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from femnl.core.device import Model
from femnl.core.outline import Holes, Outline, Segment

Array = NDArray[np.float64]


def placed(outline: Outline, at: ArrayLike, angle: float = 0.0) -> Outline:
    """Return an outline turned about the origin by `angle` [rad], then moved by `at` (2,) [m]."""
    segments = tuple(_placed(s, np.asarray(at, float), angle) for s in outline.segments)
    return replace(outline, segments=segments, size=None)


def moved(model: Model, by: ArrayLike) -> Model:
    """Return a device whose edges and layers are moved by (2,) [m], and nothing else of it.

    The slope of its thickness stays where it was, about the origin.
    """
    step = np.asarray(by, float)
    overhang = model.overhang
    if overhang is not None:
        overhang = replace(overhang, outline=placed(overhang.outline, step))
    return replace(
        model,
        outline=placed(model.outline, step),
        holes=Holes(model.holes.centres + step, model.holes.radius),
        openings=tuple(placed(opening, step) for opening in model.openings),
        layers=tuple(
            replace(layer, rims=tuple(placed(rim, step) for rim in layer.rims))
            for layer in model.layers
        ),
        overhang=overhang,
    )


def held(outline: Outline, clamped: bool) -> Outline:
    """Return an outline that is clamped all around, or free all around."""
    return replace(outline, segments=tuple(replace(s, clamped=clamped) for s in outline.segments))


def _placed(segment: Segment, at: Array, angle: float) -> Segment:
    c = math.cos(angle)
    s = math.sin(angle)

    def image(point: tuple[float, float]) -> tuple[float, float]:
        x, y = point
        # A turn by nothing must leave coordinates as they are written
        if angle != 0:
            x, y = c * x - s * y, s * x + c * y
        return float(at[0]) + x, float(at[1]) + y

    return replace(
        segment,
        start=image(segment.start),
        end=image(segment.end),
        centre=None if segment.centre is None else image(segment.centre),
        angle=segment.angle + angle if segment.semi_axes else 0.0,
    )
