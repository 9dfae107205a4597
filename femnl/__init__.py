"""femnl: finite elements for the mechanics and nonlinearity of stressed membranes."""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from femnl.core.lazy import lazy_names

if TYPE_CHECKING:  # what a type checker reads; at run time the names load when they are first used
    from femnl.device import geometry as geometry
    from femnl.device.geometry import load as load
    from femnl.io import measurement as measurement
    from femnl.mechanics.bands import solve_bands as solve_bands
    from femnl.mechanics.lattice import solve_cell as solve_cell
    from femnl.mechanics.lattice import solve_homogenised as solve_homogenised
    from femnl.mechanics.modes import shape_at as shape_at
    from femnl.mechanics.modes.dilution import dilution as dilution
    from femnl.mechanics.nonlinearity import solve_inertia as solve_inertia
    from femnl.mechanics.static_deflection import solve_static_deflection as solve_static_deflection
    from femnl.optics.fringe import MultilayerFringe as MultilayerFringe
    from femnl.optics.fringe import SeriesFringe as SeriesFringe
    from femnl.optics.fringe import SineFringe as SineFringe
    from femnl.pipeline import harmonic_maps as harmonic_maps
    from femnl.pipeline import solve_modes as solve_modes
    from femnl.pipeline import solve_modes_near as solve_modes_near
    from femnl.pipeline import solve_modes_to as solve_modes_to
    from femnl.pipeline import solve_nonlinearity as solve_nonlinearity

__version__ = "0.2.0"

# Heavy libraries load when a name is first used, so that the command line answers at once.
_HOMES = {
    "load": "femnl.device.geometry",
    "solve_modes": "femnl.pipeline",
    "solve_modes_near": "femnl.pipeline",
    "solve_modes_to": "femnl.pipeline",
    "solve_nonlinearity": "femnl.pipeline",
    "solve_inertia": "femnl.mechanics.nonlinearity",
    "solve_bands": "femnl.mechanics.bands",
    "solve_static_deflection": "femnl.mechanics.static_deflection",
    "solve_homogenised": "femnl.mechanics.lattice",
    "solve_cell": "femnl.mechanics.lattice",
    "harmonic_maps": "femnl.pipeline",
    "shape_at": "femnl.mechanics.modes",
    "dilution": "femnl.mechanics.modes.dilution",
    "SineFringe": "femnl.optics.fringe",
    "MultilayerFringe": "femnl.optics.fringe",
    "SeriesFringe": "femnl.optics.fringe",
}
_named = lazy_names(__name__, _HOMES)
_MODULES = {"geometry": "femnl.device.geometry", "measurement": "femnl.io.measurement"}
# Packages that a session reaches by `import femnl` alone, as femnl.plot.mechanics
_PACKAGES = ("chip", "diagnose", "effects", "fits", "io", "plot", "sweep")
__all__ = ["__version__", *_HOMES, *_MODULES]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(_MODULES[name])
    if name in _PACKAGES:
        return import_module(f"femnl.{name}")
    return _named(name)


def __dir__() -> list[str]:
    return [*__all__, *_PACKAGES]


# What a notebook shows as a picture, beside its table, and who draws it; like the names above, only
# when it is needed.
_PICTURED = (
    ("femnl.core.device", "Model"),
    ("femnl.core.modes", "Modes"),
    ("femnl.core.readout", "HarmonicMap"),
)
_PAINTER = "femnl.plot.notebook"


def _bundle(value: Any) -> Any:
    # A terminal shows neither, and to draw takes seconds
    shown = sys.modules["IPython"].get_ipython().display_formatter.active_types
    return import_module(_PAINTER).bundle(value) if "image/png" in shown else {}


def _show_pictures_in_notebooks() -> None:
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    if shell is not None:
        for module, name in _PICTURED:
            shell.display_formatter.mimebundle_formatter.for_type_by_name(module, name, _bundle)


_show_pictures_in_notebooks()
