"""What the command line loads: help, lists, completion and refusals need no library of numbers."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
HEAVY = (
    "dask",
    "gmsh",
    "h5py",
    "matplotlib",
    "meshio",
    "numba",
    "numpy",
    "pandas",
    "pint",
    "pyvista",
    "scipy",
    "skfem",
    "xarray",
)
MOST = 700
"""Modules, those of Python and typer included; with numpy, scipy and xarray it is 1900."""
COMMANDS = sorted(
    path.stem.strip("_")
    for path in (ROOT / "femnl" / "cli").glob("*.py")
    if not path.stem.startswith("_")
)
LOADED = (
    "import atexit, sys; "
    "atexit.register(lambda: print('LOADED', *sys.modules, file=sys.__stderr__)); "
    "from femnl.cli import main; main()"
)


def loaded(words: list[str], folder: Path, **environment: str) -> set[str]:
    """Return the modules that a command has loaded when it ends."""
    done = subprocess.run(
        [sys.executable, "-c", LOADED, *words],
        env=os.environ | {"PYTHONPATH": str(ROOT)} | environment,
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    lines = [line for line in done.stderr.splitlines() if line.startswith("LOADED ")]
    assert len(lines) == 1, done.stderr
    return set(lines[0].split()[1:])


@pytest.mark.parametrize(
    "words",
    [
        ["--help"],
        ["--version"],
        *([command, "--help"] for command in COMMANDS),
        ["geometries"],
        ["modes", "square-270"],
        ["fit", "missing.nc"],
        ["diagnose", "missing.nc"],
        ["effects", "--effects", "missing"],
        ["show", "device.toml"],
        ["diagnose", "device.toml"],
        ["maps", "circle", "--z", "-1"],
        ["maps", "circle", "--z", "4", "--fringe", "cosine"],
        ["view", "circle", "wind"],
        ["view", "circle", "--mode", "0"],
        ["modes", "circle", "--frobnicate"],
        ["frobnicate"],
    ],
    ids=" ".join,
)
def test_help_lists_and_refusals_load_no_library_of_numbers(
    words: list[str], tmp_path: Path
) -> None:
    (tmp_path / "device.toml").write_text('[outline]\nkind = "circle"\n', encoding="utf-8")
    found = loaded(words, tmp_path)
    assert found.isdisjoint(HEAVY)
    assert len(found) < MOST


def test_completion_loads_no_library_of_numbers(tmp_path: Path) -> None:
    found = loaded(
        [],
        tmp_path,
        _FEMNL_COMPLETE="complete_bash",
        COMP_WORDS="femnl modes --tens",
        COMP_CWORD="2",
    )
    assert found.isdisjoint(HEAVY)


def test_modes_that_were_kept_are_shown_without_mesher_and_tables(tmp_path: Path) -> None:
    words = ["modes", "circle", "-n", "1", "--resolution", "0.5"]
    loaded(words, tmp_path, XDG_CACHE_HOME=str(tmp_path))
    found = loaded(words, tmp_path, XDG_CACHE_HOME=str(tmp_path))
    assert found.isdisjoint({"gmsh", "meshio", "numba", "pandas", "pint", "pyvista", "xarray"})
