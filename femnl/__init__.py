"""femnl: finite elements for the mechanics and nonlinearity of stressed membranes."""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

# Heavy libraries load when a name is first used, so that the command line answers at once.
_HOMES = {
    "load": "femnl.geometry",
    "solve_modes": "femnl.predict",
    "solve_nonlinearity": "femnl.predict",
    "harmonic_maps": "femnl.predict",
    "shape_at": "femnl.modes",
    "SineFringe": "femnl.optics",
    "MultilayerFringe": "femnl.optics",
    "SeriesFringe": "femnl.optics",
}
__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'femnl' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return __all__
