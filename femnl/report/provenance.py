"""What the report was made with: versions, commit, machine, hashes of the geometry files, date."""

import hashlib
import os
import platform
import subprocess
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import femnl
from femnl.core.device import Model

PACKAGES = (
    "numpy",
    "scipy",
    "scikit-fem",
    "gmsh",
    "cvxopt",
    "tmm",
    "xarray",
    "h5netcdf",
    "pyvista",
    "vtk",
    "matplotlib",
    "jinja2",
)


def provenance(models: Sequence[Model]) -> list[tuple[str, str]]:
    """Return names and values, in the order of the report's last table."""
    rows = [("femnl", femnl.__version__), ("source", _commit(Path(femnl.__file__).parents[1]))]
    rows += [
        (
            "Python",
            f"{platform.python_version()} on {platform.system()} {platform.machine()}, "
            f"{os.cpu_count()} processors",
        )
    ]
    rows += [(name, _version(name)) for name in PACKAGES]
    rows += [
        (f"SHA-256 of {model.name}", hashlib.sha256(model.text.encode()).hexdigest())
        for model in models
    ]
    return [*rows, ("date", f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC")]


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def _commit(root: Path) -> str:
    if not (root / ".git").exists():
        return "installed package, no repository"
    try:
        commit = _git(root, "rev-parse", "HEAD")
        changed = _git(root, "status", "--porcelain", "--untracked-files=no")
    except (OSError, subprocess.CalledProcessError) as error:
        return f"repository that git cannot read here ({error})"
    return f"commit {commit}" + (", with uncommitted changes" if changed else "")


def _git(root: Path, *words: str) -> str:
    return subprocess.run(
        ["git", "-C", str(root), *words], check=True, capture_output=True, text=True
    ).stdout.strip()
