"""Geometry files: TOML with units in, a Model in SI units out, and exact measures of outlines."""

from femnl.core.resources import shipped
from femnl.device.geometry.reader import load, load_shipped, parse

__all__ = ["load", "load_shipped", "parse", "shipped"]
