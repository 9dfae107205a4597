"""Closed curves from pieces that a drawing holds one by one."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from femnl.core.outline import Outline
from femnl.device.geometry import curves
from femnl.device.geometry.crossings import counter_clockwise
from femnl.device.layout.drawing import Fault, Loop

Array = NDArray[np.float64]

GRID = 1e-9
"""Step [m] below which a drawing without a grid is rounding."""
LINES = 8
"""Lines in a row that may draw a curve as chords."""


def closed(pieces: Sequence[Loop], what: str) -> tuple[list[Array], list[Loop], list[Fault]]:
    """Join pieces end to end to closed curves.

    Args:
        pieces: lines and arcs, each a chain from a start to an end; closed ones are left as they
            are.
        what: they are called in messages.

    Returns:
        The closed curves of many lines alone, as corners (n, 2) [m], which may draw a curve; all
        others as loops; open paths as faults.
    """
    waiting = list(pieces)
    polygons: list[Array] = []
    loops: list[Loop] = []
    faults = []
    while waiting:
        chain = waiting.pop(0)
        while not meet(chain[-1].end, chain[0].start):
            following = next((k for k, p in enumerate(waiting) if _touches(chain, p)), None)
            if following is None:
                break
            piece = waiting.pop(following)
            chain += piece if meet(piece[0].start, chain[-1].end) else reverse(piece)
        if not meet(chain[-1].end, chain[0].start):
            faults.append(Fault(f"open path on {what}", chain[-1].end, True))
            continue
        chain = counter_clockwise(_joined(chain))
        if all(s.centre is None for s in chain) and len(chain) >= LINES:
            polygons.append(np.array([s.start for s in chain]))
        elif abs(curves.area(Outline("", chain, None, 0.0))) > GRID**2:
            loops.append(chain)
    return polygons, loops, faults


def reverse(chain: Loop) -> Loop:
    """Return a chain walked the other way."""
    return tuple(
        replace(s, start=s.end, end=s.start, clockwise=s.centre is not None and not s.clockwise)
        for s in chain[::-1]
    )


def _touches(chain: Loop, piece: Loop) -> bool:
    end = chain[-1].end
    return meet(piece[0].start, end) or meet(piece[-1].end, end)


def _joined(chain: Loop) -> Loop:
    """The chain with every piece starting exactly where the last one ended."""
    return tuple(replace(s, start=chain[k - 1].end) for k, s in enumerate(chain))


def meet(a: tuple[float, float], b: tuple[float, float]) -> bool:
    """Whether two points are one."""
    return bool(np.hypot(a[0] - b[0], a[1] - b[1]) < GRID)
