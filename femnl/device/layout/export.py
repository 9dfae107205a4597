"""A layout from a geometry."""

from pathlib import Path

from femnl.core.device import Model


def export_layout(model: Model, path: Path) -> None:
    pass
