"""Loops over samples and points as machine code."""

import logging
from collections.abc import Callable
from functools import cache, partial
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


@cache
def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function of arrays and numbers as machine code, which is kept on disk.

    Numba loads where it is first needed.
    """
    import numba

    translate: Callable[..., Callable[[Callable[P, R]], Callable[P, R]]] = partial(
        numba.njit, error_model="numpy"
    )
    try:
        return translate(cache=True)(function)
    except RuntimeError as error:  # neither the package's folder nor the user's can be written
        logging.getLogger("femnl").warning("machine code is compiled anew in every run: %s", error)
        return translate()(function)
