"""Loops over samples and points as machine code."""

import logging
from collections.abc import Callable
from functools import cache, partial
from types import FunctionType
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


@cache
def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function of arrays and numbers as machine code, which is kept on disk.

    So are the functions of its module that it calls. Numba loads where it is first needed.
    """
    import numba

    translate: Callable[..., Callable[[Callable[..., Any]], Callable[..., Any]]] = partial(
        numba.njit, error_model="numpy"
    )
    linked = _linked(function)
    try:
        return translate(cache=True)(linked)
    except RuntimeError as error:  # neither the package's folder nor the user's can be written
        logging.getLogger("femnl").warning("machine code is compiled anew in every run: %s", error)
        return translate()(linked)


def _linked(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that calls the machine code of its module's other functions.

    Those of other modules would go unseen when what is kept on disk is compared with its file.
    """
    if not isinstance(function, FunctionType):
        return function
    around = function.__globals__
    called = {
        name: compiled(around[name])
        for name in function.__code__.co_names
        if getattr(around.get(name), "__module__", None) == function.__module__
        and isinstance(around[name], FunctionType)
    }
    if not called:
        return function
    linked = FunctionType(
        function.__code__,
        {**around, **called},
        function.__name__,
        function.__defaults__,
        function.__closure__,
    )
    linked.__module__ = function.__module__
    linked.__qualname__ = function.__qualname__
    return linked
