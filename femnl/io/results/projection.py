"""Projections of operators onto modes, kept beside the modes they belong to."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from platformdirs import user_cache_path

from femnl.core.device import Model
from femnl.core.operators import Projection
from femnl.core.tension import TensionChanges
from femnl.io.results.cache import kept, key

FIELDS = ("slopes", "masses", "reach", "grid_x", "grid_y", "shapes")
POLYNOMIAL = ("powers", "matrices")


def cached_projection(
    model: Model, options: tuple[object, ...], compute: Callable[[], Projection]
) -> Projection:
    """Read the projection of this model and these options from the cache, or compute and keep it.

    See `kept`.
    """
    path = user_cache_path("femnl") / f"projection-{key(model, options)}.npz"

    def read() -> Projection:
        with np.load(path) as stored:
            found = {name: stored[name] for name in FIELDS}
            tension = (
                TensionChanges(*(stored[name] for name in POLYNOMIAL))
                if POLYNOMIAL[0] in stored
                else None
            )
        return Projection(**found | {"reach": float(found["reach"]), "tension": tension})

    def write(file: Path, found: Projection) -> None:
        arrays = {name: getattr(found, name) for name in FIELDS}
        if found.tension is not None:
            arrays |= {name: getattr(found.tension, name) for name in POLYNOMIAL}
        np.savez(file, **arrays)

    return kept(path, read, compute, write)
