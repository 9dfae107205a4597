"""A memory of the latest results of a pure function."""

from collections.abc import Callable, Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

T = TypeVar("T")
ROOM = 2**26
"""Bytes that the results of one function, and what they are of, may take where they are many."""
FEW = 8
"""Results that are kept whatever they take: fits of pairs of causes ask for no earlier ones."""


def recent(find: Callable[..., T], most: int = 12) -> Callable[..., T]:
    """Return a pure function of arrays that keeps its latest results, which nobody may change.

    A fit moves its parameters in turn, and many of them act late, so that the results before them
    are asked for again and again. Of results as long as a large map fewer are kept than `most`.
    """
    kept: dict[tuple[object, ...], T] = {}

    def found(*arguments: ArrayLike) -> T:
        arrays = [np.asarray(a) for a in arguments]
        key = tuple((a.shape, a.tobytes()) for a in arrays)
        if key in kept:
            kept[key] = kept.pop(key)  # now the latest
            return kept[key]
        result = find(*arguments)
        size = sum(a.nbytes for a in arrays) + getattr(result, "nbytes", 0)
        while len(kept) >= min(most, max(ROOM // max(size, 1), FEW)):
            del kept[next(iter(kept))]
        kept[key] = result
        return result

    return found


def recent_of(find: Callable[..., T], most: int = 12) -> Callable[..., T]:
    """Return a pure function of objects that nobody changes, and of numbers, in the same way.

    Objects count as the same where they are the same one, which is faster than to compare them.
    The first argument is an object, further ones are objects or mappings of numbers.
    """
    kept: dict[tuple[object, ...], tuple[tuple[object, ...], T]] = {}

    def found(*arguments: object) -> T:
        key = tuple(tuple(a.items()) if isinstance(a, Mapping) else id(a) for a in arguments)
        if key in kept:
            kept[key] = kept.pop(key)  # now the latest
        else:
            if len(kept) == most:
                del kept[next(iter(kept))]
            # With its arguments: while they are kept no other object has their identity
            kept[key] = arguments, find(*arguments)
        return kept[key][1]

    return found
