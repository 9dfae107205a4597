"""Which modes of the simulated film the labels of a spectrum name."""

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.core.readout import Array
from femnl.fits.spectrum.numbered import numbered_mode
from femnl.fits.spectrum.round_labels import is_round, round_modes
from femnl.observe.film import SimulatedFilm

PLAIN = re.compile(r"\(?(\d+),(\d+)\)?")
PAIR = re.compile(r"\(?(\d+),(\d+)\)?([+\-−])\(?(\d+),(\d+)\)?")


@dataclass(frozen=True)
class Named:
    """Modes that labels name.

    order (n,): a mode of the simulated film for each label, each one once; of the two of a pair the
    lower one for their sum. target (n, n_modes): each label's shape in the simulated modes of
    modal mass 1.
    """

    order: NDArray[np.int64]
    target: Array


def named_modes(label: tuple[str, ...], film: SimulatedFilm) -> Named:
    """Return the modes of the simulated film that labels "m,n" or "(m,n)±(p,q)" name.

    In a pair, each mode has the sign of sin(mπ(x/Lx + ½)) sin(nπ(y/Ly + ½)). Labels of a round film
    are nodal diameters and circles, see `round_modes`.

    Raises: MeasurementError for a label that is no mode of the film, and for one that comes twice.
    """
    if is_round(film.model.outline):
        return Named(*round_modes(label, film))
    rows = [_parts(name, film) for name in label]
    order: list[int] = []
    for name, row in zip(label, rows, strict=True):
        own = sorted(row)
        # The sum takes the lower of the two, the difference the higher one.
        index = own[0] if len(own) == 1 or row[own[0]] * row[own[-1]] > 0 else own[-1]
        if index in order:
            raise MeasurementError(
                f"spectrum/label: {name!r} names a mode that another label names too; correct the "
                "labels"
            )
        order.append(index)
    target = np.zeros((len(label), len(film.modes.label)))
    for place, row in enumerate(rows):
        for index, weight in row.items():
            target[place, index] = weight
    return Named(np.array(order, dtype=np.int64), target)


def _parts(name: str, film: SimulatedFilm) -> dict[int, float]:
    """Return the modes in a label with their weights, whose squares add up to 1."""
    if PLAIN.fullmatch(name):
        return _single(name, film)
    numbered = numbered_mode(name, film)
    if numbered is not None:
        return {numbered: 1.0}
    pair = PAIR.fullmatch(name)
    if pair is None:
        raise MeasurementError(
            f"spectrum/label: {name!r} is no mode; write it as 1,2 or as (1,3)+(3,1)"
        )
    m, n, sign, p, q = pair.groups()
    first = f"({m},{n})"
    second = f"({p},{q})"
    low, high = sorted((first, second))
    joined = f"{low}{'+' if sign == '+' else '−'}{high}"
    if joined in film.modes.label:
        return {film.modes.label.index(joined): 1.0}
    side = 1.0 if sign == "+" else -1.0
    return {
        _index(first, name, film): _sign((int(m), int(n)), first, film) * np.sqrt(0.5),
        _index(second, name, film): side * _sign((int(p), int(q)), second, film) * np.sqrt(0.5),
    }


def _single(name: str, film: SimulatedFilm) -> dict[int, float]:
    """Return the mode of a label "m,n", or the two hybrids that it is the sum of.

    Bending splits pairs such as (2,4) and (4,2) of a square into (2,4)+(4,2) and (2,4)−(4,2).
    """
    m, n = (int(order) for order in name.strip("()").split(","))
    low, high = sorted((f"({m},{n})", f"({n},{m})"))
    hybrids = [f"{low}{side}{high}" for side in "+−"]
    mode = f"({m},{n})"
    if mode in film.modes.label or any(hybrid not in film.modes.label for hybrid in hybrids):
        return {_index(mode, name, film): 1.0}
    return {
        film.modes.label.index(hybrid): _sign((m, n), hybrid, film) * float(np.sqrt(0.5))
        for hybrid in hybrids
    }


def _index(mode: str, name: str, film: SimulatedFilm) -> int:
    names = film.modes.label
    if mode not in names:
        raise MeasurementError(
            f"spectrum/label: {name!r} is none of the first {len(names)} modes of "
            f"{film.model.name}; correct it"
        )
    return names.index(mode)


def _sign(orders: tuple[int, int], mode: str, film: SimulatedFilm) -> float:
    """Return whether a simulated mode points as the product of sines that it is named after."""
    table = film.projection
    shape = table.shapes[film.modes.label.index(mode)]
    along_x, along_y = (
        np.sin(order * np.pi * (axis / (2 * axis[-1]) + 0.5))
        for order, axis in zip(orders, (table.grid_x, table.grid_y), strict=True)
    )
    return float(np.sign(along_y @ shape @ along_x))
