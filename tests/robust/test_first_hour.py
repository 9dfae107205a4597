"""A newcomer's first hour, by the clock: the wheel alone in a fresh environment, and the pages.

The pages are followed to the letter: every file is saved, every command and program is run.
"""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.test_docs import BLOCK, FILE

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = ("tutorial.md", "howto/geometry.md", "howto/import.md", "howto/diagnose.md")
"""In the order in which a newcomer reads; of the how-tos, what stands before their sections."""
MILESTONES = {
    "first frequencies": ("femnl modes square-270um --count 4", 2 * 60),
    "frequencies of an own geometry": ("femnl modes drum.toml --count 3", 10 * 60),
    "a diagnosis of own data": ("femnl diagnose pressure.nc --out pressure", 15 * 60),
}
"""Command that ends each, and seconds since the installation that it may take."""


def install(folder: Path) -> Path:
    """Install the wheel with what it needs into a fresh environment; its folder of programs."""
    build = ["-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder)]
    subprocess.run([sys.executable, *build], cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    subprocess.run([sys.executable, "-m", "venv", str(folder / "venv")], check=True)
    programs = folder / "venv" / "bin"
    command = [str(programs / "python"), "-m", "pip", "install", "--quiet", str(wheel)]
    subprocess.run(command, cwd=folder, check=True)
    return programs


def steps(page: str) -> Iterator[tuple[str, str]]:
    """Yield the blocks of a page in their order: what kind they are, and their text."""
    text = (DOCS / page).read_text(encoding="utf-8")
    yield from BLOCK.findall(text if page == "tutorial.md" else text.partition("\n## ")[0])


@pytest.mark.slow
def test_the_first_hour_ends_with_a_diagnosis_of_own_data(
    tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    began = time.monotonic()
    programs = install(tmp_path)
    record_property("installation", time.monotonic() - began)
    folder = tmp_path / "first-hour"
    folder.mkdir()
    known = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    environment = known | {
        "PATH": f"{programs}:{os.environ['PATH']}",
        "XDG_CACHE_HOME": str(tmp_path / "cache"),
    }
    began = time.monotonic()
    reached: dict[str, float] = {}

    def run(*words: str) -> None:
        done = subprocess.run(
            words, cwd=folder, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, (words, done.stderr)

    for page in PAGES:
        programs_of_page: list[str] = []
        for kind, text in steps(page):
            named = FILE.match(text)
            if named is not None:
                (folder / named[1]).write_text(text[named.end() :], encoding="utf-8")
            elif kind == "python":
                programs_of_page.append(text)
                run("python", "-c", "\n".join(programs_of_page))
            else:
                assert kind == "sh", page
                for line in text.splitlines():
                    run("sh", "-c", line)
                    reached[line] = time.monotonic() - began
    for milestone, (command, most) in MILESTONES.items():
        record_property(milestone, reached[command])
        assert reached[command] < most, milestone
