"""Where the shipped geometries and validation cases lie.

Inside an installed wheel, or at the top of a checkout.
"""

from pathlib import Path

_PACKAGE = Path(__file__).parents[1]


def geometries() -> Path:
    """Return the folder of the shipped geometry files, one TOML a device."""
    return _folder("geometries")


def cases() -> Path:
    """Return the folder of the shipped validation cases, one Python file a case."""
    return _folder("validation")


def _folder(name: str) -> Path:
    # A wheel carries the folder inside the package (pyproject.toml, force-include); a checkout has
    # it beside the package.
    inside = _PACKAGE / f"_{name}"
    return inside if inside.is_dir() else _PACKAGE.parent / name
