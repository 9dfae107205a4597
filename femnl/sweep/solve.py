"""One point of a sweep solved, on whatever worker it is."""

import json
import resource
import time
from collections.abc import Callable
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from femnl.core.device import Model
from femnl.core.errors import FemnlError, GeometryError
from femnl.core.modes import Modes
from femnl.core.nonlinearity import Nonlinearity
from femnl.device.geometry.schema import GeometryFile
from femnl.device.geometry.tables import complaint
from femnl.mechanics.modes.dilution import dilution
from femnl.pipeline import solve_modes, solve_nonlinearity
from femnl.sweep.point import Point, Record, Settings, Tables

Array = NDArray[np.float64]

MODAL: dict[str, Callable[[Modes], tuple[Array, Array]]] = {
    "frequency": lambda modes: (modes.frequency, modes.frequency_error),
    "ratio": lambda modes: (modes.ratio, modes.ratio_error),
    "effective_mass": lambda modes: (modes.effective_mass, modes.effective_mass_error),
    "dilution": dilution,
}
GEOMETRIC: dict[str, Callable[[Nonlinearity], tuple[Array, Array]]] = {
    "alpha": lambda found: (found.alpha, found.alpha_error),
    "k3": lambda found: (found.k3, found.k3_error),
}

NUMERICAL = (FemnlError, ArithmeticError, ValueError, RuntimeError, MemoryError, OSError)
"""What meshers and solvers raise when a device defeats them; anything else is a fault of femnl and
ends the worker.
"""

_ALONE = Lock()  # the mesher has one state a process, and a Dask worker may have several threads


def build(tables: Tables) -> Model:
    """Return the device that the tables of a geometry file describe. Raises: GeometryError."""
    try:
        return GeometryFile.model_validate(tables).build(json.dumps(tables, ensure_ascii=False))
    except ValidationError as error:
        raise GeometryError(complaint(error)) from None


def attempt(point: Point, settings: Settings) -> Record:
    """Solve one point, or say why it cannot be solved; this is what runs on workers.

    Returns: `key` and `varied` of the point, `seconds` and `memory` [bytes, the most that its
        process has had], and either `results`, every kept name and its error as lists over the
        modes, with the modes' `label`, or `error`.
    """
    began = time.perf_counter()
    try:
        with _ALONE:
            answer: Record = {"results": solve(point, settings)}
    except NUMERICAL as error:
        answer = {"error": f"{type(error).__name__}: {error}"}
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return {
        "key": point.key(settings),
        "varied": point.varied,
        **answer,
        "seconds": time.perf_counter() - began,
        "memory": memory,
    }


def solve(point: Point, settings: Settings) -> dict[str, list[Any]]:
    """Return what `Settings.keep` names for every mode of one point, each with its error."""
    modes = solve_modes(
        build(point.tables), settings.modes, settings.symmetry, settings.resolution, cache=False
    )
    found = {name: MODAL[name](modes) for name in settings.keep if name in MODAL}
    if any(name in GEOMETRIC for name in settings.keep):
        nonlinearity = solve_nonlinearity(modes, cache=False)
        found |= {
            name: GEOMETRIC[name](nonlinearity) for name in settings.keep if name in GEOMETRIC
        }
    results: dict[str, list[Any]] = {"label": [label or "" for label in modes.label]}
    for name, (value, error) in found.items():
        if not np.all(np.isfinite(value)):
            raise ArithmeticError(f"{name} came out as {value.tolist()}")
        results[name] = value.tolist()
        # JSON knows no infinity
        results[f"{name}_error"] = [e if np.isfinite(e) else None for e in error.tolist()]
    return results
