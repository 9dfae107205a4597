"""Parameters of many models of the same sweeps, computed as one long record."""

from collections.abc import Callable, Iterator
from typing import cast

import numpy as np
from numpy.typing import NDArray

from femnl.core.effect import ManyValues, Values
from femnl.core.readout import Array, ComplexArray

AT_ONCE = 20_000
"""Points that are computed at once at most: with more of them numpy's own time no longer counts."""


def portions(count: int, n: int) -> Iterator[slice]:
    """Yield which of `count` models of n points each are computed at once, portion by portion."""
    size = max(AT_ONCE // n, 1)
    for first in range(0, count, size):
        yield slice(first, min(first + size, count))


def each_point(values: ManyValues, portion: slice, n: int) -> Values:
    """Return the parameters of a portion of the models at each of their n points, (m·n,).

    One that is the same in all of them stays a number. Effects that are `pointwise` take such an
    array for a number, but of what is whole or vanishes.
    """
    each: dict[str, float | Array] = {}
    for name, numbers in values.items():
        own = numbers[portion]
        same = np.all(own == own[0])
        each[name] = float(own[0]) if same else np.repeat(own, n)
    return cast(Values, each)


def once(find: Callable[..., ComplexArray], count: int) -> Callable[..., ComplexArray]:
    """Return a function of points as one that does not compute the same model twice.

    Many parameters act after it, so that several of `count` models are one to it.

    Args: find: from arrays (n,) and numbers to (k, n), each point for itself.
    """

    def found(*arguments: Array | float) -> ComplexArray:
        arrays = [np.asarray(a) for a in arguments]
        rows = [np.reshape(a, (count, -1)) if a.ndim else a for a in arrays]
        first: dict[bytes, int] = {}
        which = [
            first.setdefault(b"".join(a[k].tobytes() for a in rows if a.ndim), k)
            for k in range(count)
        ]
        kept = list(first.values())
        one = find(*(a[kept].ravel() if a.ndim else a for a in rows))
        place = [kept.index(k) for k in which]
        each = one.reshape(len(one), len(kept), -1)[:, place]
        return np.asarray(each.reshape(len(one), -1))

    return found


def heights_at(position: NDArray[np.intp], place: tuple[str, ...], base: Values) -> ComplexArray:
    """Return what each point (n,) shows of the resonance by the drive, with its phase [V/V].

    Args: position (n,): of the readout. place: suffix of the parameters of each position.
    """
    size = [base[f"height{name}"] for name in place]
    turn = [base[f"phase{name}"] for name in place]
    numbers = np.array(np.broadcast_arrays(*size, *turn))
    heights = numbers[: len(size)] * np.exp(1j * numbers[len(size) :])
    if heights.ndim > 1:  # a value a point
        return np.asarray(heights[position, np.arange(heights.shape[1])])
    return np.asarray(heights[position])
