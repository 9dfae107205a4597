"""The wheel carries geometries and cases, works anywhere, and is built reproducibly."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest

ROOT = Path(__file__).parents[1]


def build(folder: Path) -> Path:
    """Build the wheel into a folder, without a network."""
    command = [
        sys.executable,
        "-m",
        "hatchling",
        "build",
        "--target",
        "wheel",
        "--directory",
        str(folder),
    ]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    return wheel


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of this checkout."""
    return build(tmp_path_factory.mktemp("wheel"))


def test_the_wheel_carries_every_geometry_and_every_case(wheel: Path) -> None:
    held = {Path(name) for name in ZipFile(wheel).namelist()}
    for source, inside, suffix in (
        ("geometries", "_geometries", ".toml"),
        ("validation", "_validation", ".py"),
        ("validation/published", "_validation/published", ".toml"),
    ):
        files = list((ROOT / source).glob(f"*{suffix}"))
        assert files
        assert {Path("femnl", inside, path.name) for path in files} <= held
    assert Path("femnl/report/vendor/plotly-gl3d.min.js") in held
    assert Path("femnl/report/vendor/plotly-LICENSE.txt") in held


def test_the_wheel_works_away_from_the_repository(wheel: Path, tmp_path: Path) -> None:
    site = tmp_path / "site"
    ZipFile(wheel).extractall(site)
    environment = os.environ | {"PYTHONPATH": str(site)}

    def run(script: str, *words: str) -> str:
        command = [sys.executable, "-c", script, *words]
        return subprocess.run(
            command, cwd=tmp_path, env=environment, check=True, capture_output=True, text=True
        ).stdout

    assert (
        Path(run("import femnl.core.resources as r; print(r.geometries())").strip())
        == site / "femnl" / "_geometries"
    )
    assert "square-270um" in run("from femnl.cli import main; main()", "geometries")
    assert "agrees" in run("from femnl.cli import main; main()", "validate", "erratum_linewidths")


def test_the_wheel_is_built_reproducibly(wheel: Path, tmp_path: Path) -> None:
    assert (
        hashlib.sha256(build(tmp_path).read_bytes()).digest()
        == hashlib.sha256(wheel.read_bytes()).digest()
    )
