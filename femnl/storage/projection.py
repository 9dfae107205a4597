"""Projections of operators onto modes, kept beside the modes they belong to."""

import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np
from platformdirs import user_cache_path

from femnl.storage.atomic import write_whole
from femnl.storage.cache import _key
from femnl.types.device import Model
from femnl.types.operators import Projection

FIELDS = ("slopes", "masses", "reach", "axis", "shapes")


def cached_projection(model: Model, options: tuple[object, ...], compute: Callable[[], Projection]) -> Projection:
    """Read the projection of this model and these options from the cache, or compute and keep it."""
    path = user_cache_path("femnl") / f"projection-{_key(model, options)}.npz"
    if path.exists():
        try:
            with np.load(path) as stored:
                return Projection(stored["slopes"], stored["masses"], float(stored["reach"]), stored["axis"], stored["shapes"])
        except (OSError, KeyError, ValueError) as error:
            logging.getLogger("femnl").warning("%s: unreadable in the cache (%s); computed anew", path, error)
    found = compute()

    def save(file: Path) -> None:
        with file.open("wb") as handle:
            np.savez(handle, **{name: getattr(found, name) for name in FIELDS})

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, save)
    except OSError as error:
        logging.getLogger("femnl").warning("the projection was not kept in the cache: %s", error)
    return found
