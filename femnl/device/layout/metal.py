"""A layer on the film: its region as a combined shape of a geometry file, and its numbers."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import ParameterError
from femnl.device.geometry import curves
from femnl.device.layout.drawing import Placed, moved, read_pairs
from femnl.device.layout.recognise import outline_of
from femnl.device.layout.regions import Drawn
from femnl.device.layout.tables import outline_keys, written

Keys = dict[str, Any]

ALUMINIUM: Mapping[str, Any] = {
    "thickness": "50 nm",
    "young": "70 GPa",
    "poisson": 0.34,
    "density": "2700 kg/m^3",
    "stress": "0 MPa",
}
"""For the numbers of a layer that nobody gives: a layout holds none."""


FORM = ("key=value", "thickness=30 nm,stress=50 MPa")
"""How numbers of a metal are written."""


def read_metal(text: str) -> Keys:
    """Return the numbers of a layer by key of a text such as "thickness=30 nm,stress=50 MPa".

    Raises:
        ParameterError: an unknown key, one given twice, or no number where one belongs.
    """
    found: Keys = {**read_pairs("--metal", text, ALUMINIUM, FORM)}
    if "poisson" in found:
        found["poisson"] = _number(found["poisson"])
    return found


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ParameterError(f'--metal poisson="{text}": expected a number such as 0.34') from None


def parts_of(regions: Sequence[Drawn], origin: NDArray[np.float64]) -> Keys:
    """Return a combined shape of regions: each added, then its holes subtracted.

    Args:
        regions: of the layout.
        origin: (2,) [m] of the geometry in the layout.
    """
    # The larger first, as one may lie in a hole of another
    ordered = sorted(regions, key=lambda region: -abs(curves.area(outline_of(region.outer.there))))
    parts = []
    for region in ordered:
        parts.append(_part(region.outer, origin))
        parts += [_part(hole, origin) | {"operation": "subtract"} for hole in region.inner]
    return {"kind": "combined", "parts": parts}


def _part(curve: Placed, origin: NDArray[np.float64]) -> Keys:
    x0, y0, x1, y1 = curves.box(outline_of(curve.there))
    middle = np.array([x0 + x1, y0 + y1]) / 2
    shape = outline_keys(moved(curve.there, -middle))
    # A turned ellipse is a part already
    part = shape["parts"][0] if shape["kind"] == "combined" else {"shape": shape}
    return {**part, "at": [written(place) for place in (middle - origin).tolist()]}
