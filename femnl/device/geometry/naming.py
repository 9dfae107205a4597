"""Names that files may give, and what messages call holes and points."""

import re

import numpy as np
from numpy.typing import NDArray

from femnl.core.outline import Holes
from femnl.device.geometry.quantities import refusal

Array = NDArray[np.float64]


def name(holes: Holes, index: int) -> str:
    """Return what messages call a hole: its number, counted from 1, and its position."""
    return f"hole {index + 1} at {place(holes.centres[index])}"


def place(point: Array) -> str:
    """Return a point (2,) [m] as messages write it."""
    x, y = np.round(point * 1e6, 9) + 0.0  # no −0
    return f"({x:.6g}, {y:.6g}) um"


def plain_name(value: str) -> str:
    """Return the name, refused where a file or a picture could not carry it."""
    if not re.fullmatch(r"\w[\w .,+()-]{0,99}", value):
        raise refusal(
            "expected at most 100 letters, digits, spaces and . , _ + - ( ), a letter or "
            "digit first"
        )
    return value
