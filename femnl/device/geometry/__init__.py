"""Geometry files: TOML with units in, a Model in SI units out, and exact measures of outlines."""

from femnl.device.geometry.reader import load, load_shipped, parse, shipped

__all__ = ["load", "load_shipped", "parse", "shipped"]
