"""Solved modes by content: the same device, options and code give the file of an earlier run."""

import hashlib
import logging
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from platformdirs import user_cache_path

from femnl.core.device import Model
from femnl.core.errors import ParameterError
from femnl.core.modes import Modes
from femnl.core.nonlinearity import Nonlinearity
from femnl.io.results import cache_folder
from femnl.io.results.atomic import write_whole
from femnl.io.results.netcdf import read_modes, write_modes

SEAL = hashlib.sha256().digest_size  # bytes
STAGES = ("core", "device", "mechanics", "observe/film.py", "pipeline.py", "io/results")
LIBRARIES = ("gmsh", "numpy", "scikit-fem", "scipy")
Result = TypeVar("Result")


def cached_modes(model: Model, options: tuple[object, ...], solve: Callable[[], Modes]) -> Modes:
    """Read the modes of this model and these options from the cache, or solve and keep them.

    See `kept`.
    """
    path = user_cache_path("femnl") / f"modes-{key(model, options)}.nc"
    return kept(path, lambda: read_modes(path, model), solve, write_modes)


def cached_nonlinearity(
    modes: Modes, edge: str, tensor: bool, solve: Callable[[], Nonlinearity]
) -> Nonlinearity:
    """Read the nonlinearity of these modes from the cache, or solve and keep it; see `kept`."""
    digest = hashlib.sha256(key(modes.domain.model, (edge, tensor)).encode())
    for solved in modes.grades:
        for part in (
            solved.domain.mesh.doflocs,
            solved.domain.mesh.t,
            solved.prestress.displacement,
            solved.shapes,
            solved.frequency,
        ):
            digest.update(np.ascontiguousarray(part).tobytes())
    path = user_cache_path("femnl") / f"nonlinearity-{digest.hexdigest()[:32]}.npz"

    def read() -> Nonlinearity:
        with np.load(path) as stored:
            return Nonlinearity(
                edge, **{name: value for name, value in stored.items() if value.size}
            )

    def write(file: Path, found: Nonlinearity) -> None:
        none = np.empty(0)
        full, full_error = (
            none if part is None else part for part in (found.tensor, found.tensor_error)
        )
        bars: dict[str, Any] = {
            "k3_error": found.k3_error,
            "alpha_error": found.alpha_error,
            "tensor_error": full_error,
        }
        np.savez(file, k3=found.k3, alpha=found.alpha, tensor=full, **bars)

    return kept(path, read, solve, write)


def kept(
    path: Path,
    read: Callable[[], Result],
    solve: Callable[[], Result],
    write: Callable[[Path, Result], None],
) -> Result:
    """Read an earlier result from `path`, or solve it and keep it there by `write`.

    What exceeds the limit of the cache goes, the least recently used first. A digest at the end of
    the file tells whether it is as it was written. A file that is not, or a folder that cannot be
    written, is reported as a warning and the result is solved.
    """
    if path.exists():
        try:
            _check_seal(path)
            found = read()
            cache_folder.used(path)
            return found
        except (OSError, KeyError, ValueError) as error:
            logging.getLogger("femnl").warning(
                "%s: unreadable in the cache (%s); solved anew", path, error
            )
    result = solve()

    def write_sealed(file: Path) -> None:
        write(file, result)
        with file.open("ab") as stream:
            stream.write(_digest(file, file.stat().st_size))

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, write_sealed)
        cache_folder.trim(path)
    except (OSError, ParameterError) as error:
        logging.getLogger("femnl").warning("a result was not kept in the cache: %s", error)
    return result


def _check_seal(path: Path) -> None:
    """Raise ValueError for a file that is not as it was written.

    HDF5 and zip files may end in bytes of others.
    """
    size = path.stat().st_size - SEAL
    with path.open("rb") as stream:
        stream.seek(max(size, 0))
        seal = stream.read()
    if size < 0 or seal != _digest(path, size):
        raise ValueError("not as it was written")


def _digest(path: Path, size: int) -> bytes:
    """Return the SHA-256 of the first bytes of a file."""
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while size > 0 and (part := stream.read(min(size, 2**20))):
            digest.update(part)
            size -= len(part)
    return digest.digest()


def key(model: Model, options: tuple[object, ...]) -> str:
    """Return a name for this device with these options, under the code as it is."""
    digest = hashlib.sha256(_code().encode())
    holes = np.ascontiguousarray(model.holes.centres)
    for part in (
        model.outline,
        model.openings,
        model.film,
        model.clamp,
        model.overhang,
        model.layers,
        model.bending,
        model.grid,
        model.holes.radius,
        holes.shape,
        options,
    ):
        digest.update(repr(part).encode())
    digest.update(holes.tobytes())
    return digest.hexdigest()[:32]


@cache
def _code() -> str:
    """Return a digest of the source of every stage that results depend on, and of its libraries.

    With it a change of code never meets an old file.
    """
    root = Path(__file__).parents[2]
    files = sorted(
        f
        for stage in STAGES
        for f in ([root / stage] if stage.endswith(".py") else (root / stage).rglob("*.py"))
    )
    versions = " ".join(f"{name} {version(name)}" for name in LIBRARIES).encode()
    return hashlib.sha256(versions + b"".join(f.read_bytes() for f in files)).hexdigest()
