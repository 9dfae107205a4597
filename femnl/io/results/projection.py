"""Projections of operators onto modes, kept beside the modes they belong to."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from platformdirs import user_cache_path

from femnl.core.device import Model
from femnl.core.operators import Projection
from femnl.io.results.cache import kept, key

FIELDS = ("slopes", "masses", "reach", "grid_x", "grid_y", "shapes", "yielded")


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
        return Projection(**found | {"reach": float(found["reach"])})

    def write(file: Path, found: Projection) -> None:
        np.savez(file, **{name: getattr(found, name) for name in FIELDS})

    return kept(path, read, compute, write)
