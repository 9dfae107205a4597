"""Which modes of a round film the labels of a spectrum name, by nodal diameters and circles."""

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.core.outline import Outline
from femnl.core.readout import Array
from femnl.fits.spectrum.numbered import numbered_mode
from femnl.observe.film import SimulatedFilm

ORDERS = re.compile(r"\(?(\d+),(\d+)\)?")
RINGS = 24
"""Radii at which a shape is looked at."""
ANGLES = 256
"""Directions on each of them."""
PURE = 0.9
"""Part of a shape that one angular order holds, from which on the shape has that order."""
UNKNOWN_TURN = np.pi / 8
"""Angle [rad] in the plane of a pair at which one of its modes is looked for whose turn about the
centre is not known: neither along the axes nor along the diagonals, where a cause that splits the
pair would leave two modes equally near.
"""
Orders = tuple[int, int]
"""Nodal diameters and nodal circles of a mode, the edge among the circles."""


def is_round(outline: Outline) -> bool:
    """Whether modes have nodal diameters and circles: only a circle's are all of that form."""
    return outline.kind == "circle"


def round_orders(film: SimulatedFilm) -> tuple[Orders | None, ...]:
    """Return nodal diameters and circles of each mode of a round film, the edge among the circles.

    J_m(j_mn r/R) cos(mθ + φ). m is the angular order of the shape; n counts the modes of that order
    by frequency, which rises with n, two to each n where m > 0. None where no angular order holds
    `PURE` of a shape, as where holes bend it; the counts of higher modes are then not known either.
    """
    angular = _angular_orders(film)
    found: list[Orders | None] = []
    counts: dict[int, int] = {}
    for m in angular:
        if m is None or None in found:
            found.append(None)
            continue
        before = counts.get(m, 0)
        counts[m] = before + 1
        found.append((m, 1 + before // (2 if m else 1)))
    return tuple(found)


def round_modes(label: tuple[str, ...], film: SimulatedFilm) -> tuple[NDArray[np.int64], Array]:
    """Return the modes of a round film that labels name, and the shape that each one names.

    A label is "m,n", or "mode N" as of an overview, which means the orders m, n of that mode.

    The two modes of a pair bear the same label; where it comes once, which of them it means is not
    known, and makes no difference unless a cause splits the pair.

    Returns: the mode (n,) of each label, each one once, and the shapes (n, n_modes) in the
    simulated modes of modal mass 1.
    Raises: MeasurementError for a label that is no mode of the film, or that comes too often.
    """
    orders = round_orders(film)
    order: list[int] = []
    target = np.zeros((len(label), len(orders)))
    for place, name in enumerate(label):
        alike = _alike(name, orders, film)
        left = [k for k in alike if k not in order]
        if not left:
            raise MeasurementError(
                f"spectrum/label: {name!r} comes more often than the modes that it names, "
                f"{len(alike)}; correct the labels"
            )
        order.append(left[0])
        turns = len(alike) > 1 and _count(label, name, orders, film) == 1
        target[place, left[0]] = np.cos(UNKNOWN_TURN) if turns else 1.0
        if turns:
            target[place, alike[1]] = np.sin(UNKNOWN_TURN)
    return np.array(order, dtype=np.int64), target


def _alike(name: str, orders: Sequence[Orders | None], film: SimulatedFilm) -> list[int]:
    """Return the modes that a label names, two of a pair."""
    named = _parsed(name, orders, film)
    alike = [k for k, own in enumerate(orders) if named in (k, own)]
    if not alike:
        raise MeasurementError(
            f"spectrum/label: {name!r} is none of the first {len(orders)} modes of "
            f"{film.model.name}, a round film: write its nodal diameters and nodal circles, the "
            "edge among them, as 0,1 for the lowest mode"
        )
    return alike


def _count(
    label: tuple[str, ...], name: str, orders: Sequence[Orders | None], film: SimulatedFilm
) -> int:
    """Return how often a mode is named."""
    named = _parsed(name, orders, film)
    return sum(_parsed(other, orders, film) == named for other in label)


def _parsed(name: str, orders: Sequence[Orders | None], film: SimulatedFilm) -> Orders | int:
    """Return the orders that a label means, or its mode from 0 where that has none."""
    mode = numbered_mode(name, film)
    if mode is not None:
        return orders[mode] or mode
    match = ORDERS.fullmatch(name)
    if match is None:
        raise MeasurementError(
            f"spectrum/label: {name!r} is no mode of a round film; write it as 1,2: nodal "
            "diameters and nodal circles, the edge among them"
        )
    m, n = match.groups()
    return int(m), int(n)


def _angular_orders(film: SimulatedFilm) -> list[int | None]:
    """Return the angular order m of each mode, None where several share its shape.

    It is read from the Fourier series of the shape around rings of equal area.
    """
    radius = film.model.outline.length / 2 * np.sqrt((np.arange(RINGS) + 0.5) / RINGS)
    angle = 2 * np.pi * np.arange(ANGLES) / ANGLES
    shape = film.projection.at(np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle)))
    power: Array = np.sum(np.abs(np.fft.rfft(shape, axis=-1)) ** 2, axis=1)
    # Positive and negative orders stand in one place each, but for the constant
    power[:, 1:] *= 2
    share = power / power.sum(axis=1, keepdims=True)
    return [int(np.argmax(row)) if row.max() >= PURE else None for row in share]
