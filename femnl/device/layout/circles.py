"""Circles that corners of a layout lie on, rounded to its grid."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FITTED = 1.1
"""Steps of the grid by which corners may lie off the circle or ellipse of least squares, which
chance leads astray."""
MOVED = 50.0
"""Steps of the grid by which a radius may move for a round number: a short arc hardly fixes it."""
MOVED_ALL_AROUND = 3 * FITTED
"""The same where corners lie all around: they cannot all lie within FITTED of two circles whose
radii differ by more than twice that."""
CENTRING = 4  # steps at most, of Gauss and Newton
CENTRED = 1e-9  # of the radius, the last step
STEPS = (1000.0, 500.0, 100.0, 50.0, 10.0, 5.0, 1.0, 0.5, 0.1)
"""Steps of the grid in which a radius is tried, the roundest number first."""


@dataclass(frozen=True)
class Circle:
    """A circle that chords follow within a tolerance."""

    centre: Array
    radius: float

    def off(self, points: Array) -> float:
        """Return how far the farthest of points (n, 2) lies off the circle."""
        return float(np.abs(np.hypot(*(points - self.centre).T) - self.radius).max())


def fitted(points: Array) -> Circle | None:
    """The circle whose algebraic distance x² + y² − 2c·x − k is least (Kåsa)."""
    middle = points.mean(axis=0)
    scale = float(np.abs(points - middle).max())
    x = (points - middle) / scale
    columns = np.concatenate([2 * x, np.ones((len(x), 1))], axis=1)
    solution, _, rank, _ = np.linalg.lstsq(columns, np.sum(x * x, axis=1), rcond=1e-9)
    square = solution[2] + solution[:2] @ solution[:2]
    if rank < 3 or square <= 0:
        return None
    return Circle(middle + scale * solution[:2], float(scale * np.sqrt(square)))


def rounded(
    circle: Circle | None, points: Array, grid: float, moved: float = MOVED
) -> Circle | None:
    """The circle with the roundest radius and centre that all points lie on, if there is one.

    moved: steps of the grid by which its radius may move.
    """
    if circle is None or circle.off(points) > FITTED * grid:
        return None
    radii = [round(circle.radius / (step * grid)) * (step * grid) for step in STEPS]
    for radius in dict.fromkeys(radii):
        if abs(radius - circle.radius) > moved * grid or radius == 0:
            continue
        tried = _centred(Circle(circle.centre, radius), points)
        for places in (1.0, 0.5):
            centre = np.round(tried.centre / (places * grid)) * (places * grid)
            if Circle(centre, radius).off(points) <= FITTED * grid:
                return Circle(centre, radius)
        if tried.off(points) <= FITTED * grid:
            return tried
    return circle


def _centred(circle: Circle, points: Array) -> Circle:
    """The circle of the same radius from which points lie off least (Gauss–Newton)."""
    centre = circle.centre
    for _ in range(CENTRING):
        spokes = points - centre
        size = np.hypot(*spokes.T)
        step = np.linalg.lstsq(-spokes / size[:, None], circle.radius - size, rcond=None)[0]
        centre = centre + step
        if np.hypot(*step) <= CENTRED * circle.radius:
            break
    return Circle(centre, circle.radius)
