"""Many data, some at a time: all columns of a large map at once take as much memory as the rest."""

from collections.abc import Iterator

PORTION = 4096
"""Data that are taken at once."""


def portions(n_data: int) -> Iterator[slice]:
    """Yield all data, some at a time."""
    for begin in range(0, n_data, PORTION):
        yield slice(begin, begin + PORTION)
