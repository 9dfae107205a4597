"""Ellipses that a layout draws as many short chords."""

from collections import Counter

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import leastsq

from femnl.core.outline import Segment
from femnl.device.geometry import curves
from femnl.device.geometry.shapes import ellipse

Array = NDArray[np.float64]
Loop = tuple[Segment, ...]

WIDEST = np.radians(23.0)
"""A chord that turns by more is meant as a side: up to octagons and twelve-gons stay polygons."""
LED_ASTRAY = 10.0
"""Tolerances up to which corners may lie off the algebraic fit of their ellipse."""


def whole_ellipse(points: Array, tolerance: float) -> tuple[Loop, Counter[str]] | None:
    """Return the ellipse through all corners (n, 2) [m], if there is one.

    It begins as A x² + B xy + C y² + D x + E y = 1 of least squares.

    tolerance [m]: by which corners may lie off it.
    """
    if len(points) < 2 * np.pi / WIDEST:
        return None
    middle = points.mean(axis=0)
    scale = float(np.abs(points - middle).max())
    x, y = ((points - middle) / scale).T
    a, b, c, d, e = np.linalg.lstsq(
        np.stack([x * x, x * y, y * y, x, y], axis=1), np.ones(len(x)), rcond=None
    )[0]
    if 4 * a * c - b * b <= 1e-9:
        return None
    centre = np.linalg.solve([[2 * a, b], [b, 2 * c]], [-d, -e])
    level = 1 - (d * centre[0] + e * centre[1]) / 2
    values, vectors = np.linalg.eigh(np.array([[a, b / 2], [b / 2, c]]) / level)
    axes = scale / np.sqrt(values)  # the longer one first
    angle = float(np.arctan2(vectors[1, 0], vectors[0, 0]))
    start = np.array([*(middle + scale * centre), *axes, angle])
    if np.abs(_off_ellipse(start, points)[0]).max() > LED_ASTRAY * tolerance:
        return None
    best = _nearest_ellipse(start, points, scale)
    off, parts = _off_ellipse(best, points)
    widest = np.abs(np.diff(np.unwrap(np.append(parts, parts[0])))).max()
    if np.abs(off).max() > tolerance or widest > WIDEST:
        return None
    x0, y0, longer, shorter, angle = (float(value) for value in best)
    return ellipse((x0, y0), (longer, shorter), angle % np.pi), Counter(ellipses=1)


def _nearest_ellipse(start: Array, points: Array, scale: float) -> Array:
    """Return centre, half axes and angle (5,) of the ellipse from which points lie off least.

    Of the algebraic fit `start`, points at the tips of slender ellipses have little weight: the
    distances themselves are made least.
    """
    unit = np.array([scale, scale, scale, scale, 1.0])

    def off(values: Array) -> Array:
        return _off_ellipse(values, points)[0]

    found, _ = leastsq(off, start, diag=1 / unit)
    return np.asarray(found)


def _off_ellipse(ellipse: Array, points: Array) -> tuple[Array, Array]:
    """Return how far points (n, 2) lie outside of an ellipse, and their eccentric angles [rad].

    ellipse (5,): centre, half axes and angle.
    """
    x, y, longer, shorter, angle = ellipse
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    frame = turn * [longer, shorter]
    unit = np.linalg.solve(frame, (points - [x, y]).T).T
    return curves.off_ellipse(frame, unit), np.arctan2(unit[:, 1], unit[:, 0])
