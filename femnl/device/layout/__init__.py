"""Drawn layouts (GDSII, OASIS, DXF, SVG): read into geometry files, and written from them."""

from femnl.device.layout.build import Imported, import_layout
from femnl.device.layout.drawing import read_layers
from femnl.device.layout.export import WRITTEN, export_layout
from femnl.device.layout.metal import read_metal
from femnl.device.layout.readers import SUFFIXES, read_drawing

__all__ = [
    "SUFFIXES",
    "WRITTEN",
    "Imported",
    "export_layout",
    "import_layout",
    "read_drawing",
    "read_layers",
    "read_metal",
]
