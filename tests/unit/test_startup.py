"""What the command line loads: help, lists, completion and refusals need no library of numbers."""

import os
import subprocess
import sys
from pathlib import Path

import h5py
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
SLOW = {
    "dask",
    "gmsh",
    "matplotlib",
    "meshio",
    "numba",
    "pandas",
    "pint",
    "pyvista",
    "skfem",
    "xarray",
}
"""What a file or a unit that is no use is refused without, where that needs arrays."""
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


def make_files(folder: Path) -> None:
    """Make the files that the words below name, none of which is of use."""
    (folder / "folder.nc").mkdir()
    sweep = 'geometry = "circle"\n[[axis]]\n"film.{name}" = ["1 kg"]\n'
    texts = {
        "device.toml": '[outline]\nkind = "circle"\n',
        "sweep.toml": sweep.format(name="frobnicate"),
        "units.toml": sweep.format(name="stress"),
        "chip.toml": 'name = "chip"\n',
        "text.nc": "words\n",
        "empty.nc": "",
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    (folder / "noise.nc").write_bytes(bytes(range(256)))
    with h5py.File(folder / "plain.nc", "w") as file:
        file["x"] = [1.0]


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
        ["maps", "circle", "--z", "4", "--noise", "x"],
        ["maps", "circle", "--z", "4", "--wavelength", "x"],
        ["maps", "circle", "--z", "4", "--out", "x.txt"],
        ["modes", "circle", "--near", "x"],
        ["modes", "circle", "--bow", "x"],
        ["modes", "circle", "--q", "--pressure", "x"],
        ["modes", "circle", "--pressure", "1 Pa"],
        ["modes", "circle", "--edge", "hinged"],
        ["modes", "circle", "--resolution", "0"],
        ["modes", "circle", "--symmetry", "third"],
        ["modes", "circle", "--tolerance-of", "all"],
        ["modes", "circle", "--out", "x.txt"],
        ["bands", "circle", "--out", "x.txt"],
        ["sweep", "missing.toml"],
        ["sweep", "device.toml", "--out", "x.txt"],
        ["import", "missing.csv", "x.nc"],
        ["import", "device.toml", "x.nc", "--spec", "missing.toml"],
        ["show", "missing.nc"],
        ["show", "folder.nc"],
        ["show", "empty.nc"],
        ["show", "text.nc"],
        ["diagnose", "text.nc"],
        ["fit", "text.nc", "--as", "nonsense"],
        ["fit", "text.nc", "--fix", "linewidth=x"],
        ["fit", "text.nc", "--each-sweep", "x.nc", "--modes", "2"],
        ["chip", "missing.toml"],
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
    make_files(tmp_path)
    found = loaded(words, tmp_path)
    assert found.isdisjoint(HEAVY)
    assert len(found) < MOST


@pytest.mark.parametrize(
    "words",
    [
        ["modes", "device.toml"],
        ["modes", "circle", "--near", "-1"],
        ["maps", "circle", "--z", "4", "--wavelength", "1 m"],
        ["sweep", "device.toml"],
        ["sweep", "sweep.toml"],
        ["geometry", "check", "missing.toml"],
        ["chip", "device.toml"],
        ["chip", "chip.toml"],
        ["show", "noise.nc"],
        ["show", "plain.nc"],
        ["diagnose", "noise.nc"],
        ["diagnose", "plain.nc"],
        ["fit", "text.nc"],
        ["fit", "noise.nc"],
        ["fit", "plain.nc"],
        ["fit", "folder.nc"],
        ["import", "noise.nc", "x.nc"],
    ],
    ids=" ".join,
)
def test_files_are_refused_before_units_datasets_meshers_and_figures_load(
    words: list[str], tmp_path: Path
) -> None:
    make_files(tmp_path)
    assert loaded(words, tmp_path).isdisjoint(SLOW)


@pytest.mark.parametrize(
    "words",
    [
        ["modes", "circle", "--near", "1 kg"],
        ["modes", "circle", "--bow", "1 kg"],
        ["modes", "circle", "--q", "--pressure", "1 kg"],
        ["maps", "circle", "--z", "4", "--noise", "1 kg"],
        ["maps", "metallised-drum", "--z", "4", "--fringe", "multilayer"],
        ["sweep", "units.toml"],
    ],
    ids=" ".join,
)
def test_units_are_refused_before_datasets_meshers_and_figures_load(
    words: list[str], tmp_path: Path
) -> None:
    make_files(tmp_path)
    # pint itself loads dask and scipy where they are installed
    found = loaded(words, tmp_path)
    assert "pint" in found
    assert found.isdisjoint(SLOW - {"pint", "dask"})


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


def test_a_diagnosis_of_lines_or_sweeps_loads_no_distributions_of_scipy() -> None:
    # They took a second of the two that it takes to load all that a diagnosis needs
    program = (
        "import sys, femnl.diagnose, femnl.report.diagnosis;"
        "import femnl.fits.spectrum.pose, femnl.fits.response.pose, femnl.fits.series.pose;"
        "sys.exit('scipy.stats' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], env=os.environ | {"PYTHONPATH": str(ROOT)}, check=False
    )
    assert done.returncode == 0
