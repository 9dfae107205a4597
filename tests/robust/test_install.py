"""The wheel, installed in a fresh environment, works without repository and network."""

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def femnl(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the command in an environment with the dependencies of this one and femnl's wheel."""
    folder = tmp_path_factory.mktemp("install")
    build = [
        sys.executable,
        "-m",
        "hatchling",
        "build",
        "--target",
        "wheel",
        "--directory",
        str(folder),
    ]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    subprocess.run(
        [sys.executable, "-m", "venv", str(folder / "venv")], check=True, capture_output=True
    )
    python = folder / "venv" / "bin" / "python"
    (wheel,) = folder.glob("*.whl")
    install = [str(python), "-m", "pip", "install", "--no-deps", "--no-index", str(wheel)]
    subprocess.run(install, check=True, capture_output=True)
    site = subprocess.run(
        [str(python), "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"],
        check=True,
        capture_output=True,
        text=True,
    )
    Path(site.stdout.strip(), "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return folder / "venv" / "bin" / "femnl"


def run(femnl: Path, folder: Path, *words: str) -> str:
    """Run the installed command away from the repository."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | {
        "XDG_CACHE_HOME": str(folder)
    }
    return subprocess.run(
        [str(femnl), *words],
        cwd=folder,
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    ).stdout


@pytest.mark.slow
def test_the_installed_command_carries_devices_and_cases_and_solves(
    femnl: Path, tmp_path: Path
) -> None:
    where = subprocess.run(
        [str(femnl.with_name("python")), "-c", "import femnl; print(femnl.__file__)"],
        cwd=tmp_path,
        check=True,
        capture_output=True,
        text=True,
    )
    assert Path(where.stdout.strip()).is_relative_to(femnl.parents[1])
    assert "trampoline" in run(femnl, tmp_path, "geometries")
    assert run(
        femnl, tmp_path, "modes", "circle", "--count", "1", "--resolution", "0.5", "--json"
    ).startswith('{"geometry": "circle"')
    assert "agrees" in run(femnl, tmp_path, "validate", "erratum_linewidths")
    assert run(femnl, tmp_path, "--version").startswith("femnl ")
