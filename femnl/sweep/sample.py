"""Quasi-random samples of a unit cube."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

Array = NDArray[np.float64]


def draw(method: str, points: int, dimensions: int, seed: int) -> list[list[float]]:
    """Return points of a cube, each a place from 0 to 1 along every axis.

    Of `sobol` and `halton`, fewer points of the same seed are the first of more.
    """
    return [
        [float(x) for x in row]
        for row in METHODS[method](points, dimensions, np.random.default_rng(seed))
    ]


def _sobol(points: int, dimensions: int, rng: np.random.Generator) -> Array:
    # The sequence is balanced at powers of two, and a start of it is the best that other numbers
    # can have.
    return np.asarray(
        qmc.Sobol(dimensions, rng=rng).random_base2(int(np.ceil(np.log2(points))))[:points]
    )


def _halton(points: int, dimensions: int, rng: np.random.Generator) -> Array:
    return np.asarray(qmc.Halton(dimensions, rng=rng).random(points))


def _latin_hypercube(points: int, dimensions: int, rng: np.random.Generator) -> Array:
    return np.asarray(qmc.LatinHypercube(dimensions, rng=rng).random(points))


METHODS: dict[str, Callable[[int, int, np.random.Generator], Array]] = {
    "sobol": _sobol,
    "halton": _halton,
    "latin-hypercube": _latin_hypercube,
}
