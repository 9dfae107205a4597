"""The region of a layer on the film as a combined shape of a geometry file."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femnl.device.geometry import curves
from femnl.device.layout.drawing import Placed, moved
from femnl.device.layout.recognise import outline_of
from femnl.device.layout.regions import Drawn
from femnl.device.layout.tables import outline_keys, written

Keys = dict[str, Any]


def parts_of(regions: Sequence[Drawn], origin: NDArray[np.float64]) -> Keys:
    """Return a combined shape of regions: each added, and its holes subtracted.

    Args:
        regions: of the layout.
        origin: (2,) [m] of the geometry in the layout.
    """
    outer = [_part(region.outer, origin) for region in regions]
    holes = [
        _part(hole, origin) | {"operation": "subtract"}
        for region in regions
        for hole in region.inner
    ]
    return {"kind": "combined", "parts": outer + holes}


def _part(curve: Placed, origin: NDArray[np.float64]) -> Keys:
    x0, y0, x1, y1 = curves.box(outline_of(curve.there))
    middle = np.array([x0 + x1, y0 + y1]) / 2
    shape = outline_keys(moved(curve.there, -middle))
    # A turned ellipse is a part already
    part = shape["parts"][0] if shape["kind"] == "combined" else {"shape": shape}
    return {**part, "at": [written(place) for place in (middle - origin).tolist()]}
