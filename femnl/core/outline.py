"""The edges of a device: segments, outlines and round holes, in SI."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.core.arrays import freeze

CELL = "cell"
"""Kind of an outline that is no edge of the film but the sides of a cell that repeats."""
SHARP = np.pi / 3
"""Angle [rad] up to which a film between a clamped and a free edge moves smoothly."""


@dataclass(frozen=True)
class Segment:
    """One piece of an outline, which is walked counter-clockwise.

    It is a straight line, or an arc where `centre` is given.

    start, end, centre: (x, y) in m. An arc is shorter than a full turn and runs from start to end
    about its centre, counter-clockwise unless `clockwise` (where the film is hollow). `clamped`
    says whether the film is held there (True) or ends free (False). semi_axes [m] and angle [rad]
    of an elliptical arc: its half axes, and the direction of the first one; None for circles.
    """

    start: tuple[float, float]
    end: tuple[float, float]
    centre: tuple[float, float] | None = None
    clamped: bool = True
    semi_axes: tuple[float, float] | None = None
    angle: float = 0.0
    clockwise: bool = False

    @property
    def frame(self) -> NDArray[np.float64]:
        """Return the matrix (2, 2) [m] that takes the unit circle to the arc's circle or ellipse.

        The centre of the arc is its origin, and it is zero for a line.
        """
        if self.centre is None:
            return np.zeros((2, 2))
        if self.semi_axes is None:
            radius = math.dist(self.start, self.centre)
            return np.array([[radius, 0.0], [0.0, radius]])
        c = math.cos(self.angle)
        s = math.sin(self.angle)
        return np.asarray(np.array([[c, -s], [s, c]]) * self.semi_axes)

    def direction(self, point: tuple[float, float]) -> NDArray[np.float64]:
        """Return the direction in which the outline runs at one of the ends, of any length."""
        if self.centre is None:
            return np.subtract(self.end, self.start)
        x, y = np.linalg.solve(self.frame, np.subtract(point, self.centre))
        return np.asarray(self.frame @ [-y, x]) * (-1 if self.clockwise else 1)


@dataclass(frozen=True)
class Outline:
    """The closed boundary of the suspended film.

    Counter-clockwise, with the origin at the centre of the membrane.

    kind: the word of the geometry file. segments: consecutive, each starting where the last one
    ended.
    size: (width, height) of the box, in m, whose ideal modes sin·sin give the labels (m,n); None
    where (m,n) has no meaning.
    length: the length L in m that users quote for the device (side, diameter, long axis).
    """

    kind: str
    segments: tuple[Segment, ...]
    size: tuple[float, float] | None
    length: float

    @property
    def extent(self) -> tuple[float, float]:
        """Return the least and the most that the longer side of its box may be [m].

        The least is that of the ends of its segments, the most that with whole circles or ellipses
        in the place of arcs.
        """
        ends = np.array([segment.start for segment in self.segments])
        around = [
            np.asarray(segment.centre) + side * np.linalg.norm(segment.frame, axis=1)
            for segment in self.segments
            for side in (-1, 1)
            if segment.centre is not None
        ]
        widest = np.vstack([ends, *around])
        return float(np.ptp(ends, axis=0).max()), float(np.ptp(widest, axis=0).max())

    @property
    def corners(self) -> tuple[tuple[int, float], ...]:
        """Return the segments that start at a corner and the corner's inner angle [rad]."""
        found = []
        for k, after in enumerate(self.segments):
            incoming = self.segments[k - 1].direction(self.segments[k - 1].end)
            outgoing = after.direction(after.start)
            turn = np.arctan2(
                incoming[0] * outgoing[1] - incoming[1] * outgoing[0], incoming @ outgoing
            )
            if abs(turn) > 1e-6:
                found.append((k, float(np.pi - turn)))
        return tuple(found)

    @property
    def passing_corners(self) -> tuple[tuple[int, float], ...]:
        """Return the segments at whose start the edge passes between clamped and free.

        Each comes with the film's angle [rad] there. Only angles that make the film singular count.
        """
        angles = dict(self.corners)
        found = []
        for k, segment in enumerate(self.segments):
            angle = angles.get(k, np.pi)
            if segment.clamped != self.segments[k - 1].clamped and angle > SHARP:
                found.append((k, float(angle)))
        return tuple(found)


@dataclass(frozen=True)
class Holes:
    """Round release holes: centres (n, 2) in m and one radius in m. n may be 0."""

    centres: NDArray[np.float64]
    radius: float

    def __post_init__(self) -> None:
        freeze(self)
