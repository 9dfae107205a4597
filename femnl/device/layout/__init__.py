"""Drawn layouts (GDSII, OASIS, DXF, SVG): read into geometry files, and written from them."""

from typing import TYPE_CHECKING

from femnl.core.lazy import lazy_names

if TYPE_CHECKING:  # what a type checker reads; at run time the names load when they are first used
    from femnl.device.layout.build import Imported as Imported
    from femnl.device.layout.build import import_layout as import_layout
    from femnl.device.layout.drawing import read_layers as read_layers
    from femnl.device.layout.export import WRITTEN as WRITTEN
    from femnl.device.layout.export import export_layout as export_layout
    from femnl.device.layout.metal import read_metal as read_metal
    from femnl.device.layout.readers import SUFFIXES as SUFFIXES
    from femnl.device.layout.readers import read_drawing as read_drawing

# A process that reads one file needs none of what recognises curves
_HOMES = {
    "SUFFIXES": "femnl.device.layout.readers",
    "WRITTEN": "femnl.device.layout.export",
    "Imported": "femnl.device.layout.build",
    "export_layout": "femnl.device.layout.export",
    "import_layout": "femnl.device.layout.build",
    "read_drawing": "femnl.device.layout.readers",
    "read_layers": "femnl.device.layout.drawing",
    "read_metal": "femnl.device.layout.metal",
}
__getattr__ = lazy_names(__name__, _HOMES)
__all__ = [*_HOMES]
