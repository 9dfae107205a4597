"""Physical causes that can hide in data, one file each; a new file is found by itself."""

from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from femnl.core.effect import Effect

__all__ = ["library"]


@cache
def library() -> dict[str, Effect]:
    """Return every effect of this folder by name: the constant EFFECT of each file."""
    modules = (import_module(f"{__name__}.{found.name}") for found in iter_modules(__path__))
    return {effect.name: effect for effect in (module.EFFECT for module in modules)}
