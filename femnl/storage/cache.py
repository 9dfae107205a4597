"""Solved modes by content: the same device, options and code give the file of an earlier run."""

import hashlib
import logging
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from platformdirs import user_cache_path

from femnl.errors import ParameterError
from femnl.storage.results import read_modes, write_modes
from femnl.types.device import Model
from femnl.types.mechanics import Modes

STAGES = ("types", "fem", "mesh", "modes", "prestress.py", "predict.py", "storage")


def cached_modes(model: Model, options: tuple[object, ...], solve: Callable[[], Modes]) -> Modes:
    """Read the modes of this model and these options from the cache, or solve and keep them.

    A file that cannot be read, or a cache folder that cannot be written, is reported as a warning and the modes are solved.
    """
    path = user_cache_path("femnl") / f"modes-{_key(model, options)}.nc"
    if path.exists():
        try:
            return read_modes(path, model)
        except (OSError, KeyError, ValueError) as error:
            logging.getLogger("femnl").warning("%s: unreadable in the cache (%s); solved anew", path, error)
    modes = solve()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_modes(path, modes)
    except (OSError, ParameterError) as error:
        logging.getLogger("femnl").warning("the modes were not kept in the cache: %s", error)
    return modes


def _key(model: Model, options: tuple[object, ...]) -> str:
    digest = hashlib.sha256(_code().encode())
    holes = np.ascontiguousarray(model.holes.centres)
    for part in (model.outline, model.film, model.bending, model.holes.radius, holes.shape, options):
        digest.update(repr(part).encode())
    digest.update(holes.tobytes())
    return digest.hexdigest()[:32]


@cache
def _code() -> str:
    """A digest of the source of every stage that the modes depend on, so that a change of code never meets an old file."""
    root = Path(__file__).parents[1]
    files = sorted(f for stage in STAGES for f in ([root / stage] if stage.endswith(".py") else (root / stage).rglob("*.py")))
    return hashlib.sha256(b"".join(f.read_bytes() for f in files)).hexdigest()
