"""One point of a sweep: a device as tables, what is asked of it, and plain answers."""

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import Any

Tables = dict[str, Any]
Record = dict[str, Any]

VERSION = 1
"""Of what is computed for a point: results of different versions never share a store."""
KEPT = {
    "frequency": "Hz",
    "ratio": "1",
    "effective_mass": "kg",
    "dilution": "1",
    "alpha": "m^-2",
    "k3": "N/m^3",
}
"""What a sweep can keep of every mode, with its SI unit; each comes with its discretisation error.
"""


@dataclass(frozen=True)
class Settings:
    """How every point of a sweep is solved and what is kept of it.

    See `femnl.pipeline.solve_modes`.
    """

    modes: int = 6
    resolution: float = 1.0
    symmetry: str = "auto"
    keep: tuple[str, ...] = ("frequency", "ratio", "alpha")


@dataclass(frozen=True)
class Point:
    """A device of a sweep: the tables of its geometry, and the values that vary, as written."""

    tables: Tables
    varied: dict[str, Any]

    def key(self, settings: Settings) -> str:
        """A name for this device under these settings.

        The same whatever run, machine or sweep asks for it.
        """
        device = {
            name: table
            for name, table in self.tables.items()
            if name not in ("name", "source", "assumed")
        }
        content = json.dumps(
            [VERSION, device, asdict(settings)], sort_keys=True, ensure_ascii=False
        )
        return hashlib.sha256(content.encode()).hexdigest()[:24]


def failure(point: Point, settings: Settings, reason: str) -> Record:
    """The record of a point that no worker could answer."""
    return {
        "key": point.key(settings),
        "varied": point.varied,
        "error": reason,
        "seconds": 0.0,
        "memory": 0,
    }
