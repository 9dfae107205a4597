"""femnl: finite elements for the mechanics and nonlinearity of stressed membranes."""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # what a type checker reads; at run time the names load when they are first used
    from femnl.bands import solve_bands as solve_bands
    from femnl.bow import solve_bow as solve_bow
    from femnl.geometry import load as load
    from femnl.lattice import solve_cell as solve_cell
    from femnl.lattice import solve_homogenised as solve_homogenised
    from femnl.modes import shape_at as shape_at
    from femnl.modes.dilution import dilution as dilution
    from femnl.nonlinearity import solve_inertia as solve_inertia
    from femnl.optics import MultilayerFringe as MultilayerFringe
    from femnl.optics import SeriesFringe as SeriesFringe
    from femnl.optics import SineFringe as SineFringe
    from femnl.predict import harmonic_maps as harmonic_maps
    from femnl.predict import solve_modes as solve_modes
    from femnl.predict import solve_modes_to as solve_modes_to
    from femnl.predict import solve_nonlinearity as solve_nonlinearity

__version__ = "0.1.0"

# Heavy libraries load when a name is first used, so that the command line answers at once.
_HOMES = {
    "load": "femnl.geometry",
    "solve_modes": "femnl.predict",
    "solve_modes_to": "femnl.predict",
    "solve_nonlinearity": "femnl.predict",
    "solve_inertia": "femnl.nonlinearity",
    "solve_bands": "femnl.bands",
    "solve_bow": "femnl.bow",
    "solve_homogenised": "femnl.lattice",
    "solve_cell": "femnl.lattice",
    "harmonic_maps": "femnl.predict",
    "shape_at": "femnl.modes",
    "dilution": "femnl.modes.dilution",
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


# What a notebook shows as a picture, and who draws it; like the names above, only when it is needed.
_PICTURED = (("femnl.types.device", "Model"), ("femnl.types.mechanics", "Modes"), ("femnl.types.readout", "HarmonicMap"))
_PAINTER = "femnl.plot.notebook"


def _picture(value: Any) -> Any:
    return import_module(_PAINTER).picture(value)


def _show_pictures_in_notebooks() -> None:
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    if shell is not None:
        for module, name in _PICTURED:
            shell.display_formatter.formatters["image/png"].for_type_by_name(module, name, _picture)


_show_pictures_in_notebooks()
