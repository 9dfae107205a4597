"""Fixtures of many tests: devices as geometry files, and programs that can be interrupted."""

import resource
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from platformdirs import user_cache_path

from femnl.core.device import Model
from femnl.device import geometry

FILM = (
    'thickness = "1 um"\nyoung = "250 GPa"\npoisson = 0.23\ndensity = "3000 kg/m^3"\nstress '
    '= "1 GPa"'
)


def pytest_configure() -> None:
    """Let the programs that tests start be interrupted, as a user's are.

    a shell starts what runs in the background deaf to it.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def device() -> Callable[..., Model]:
    """Build a device from the tables of a geometry file; without bending unless asked for."""

    def build(
        outline: str, holes: str = "", film: str = FILM, model: str = "bending = false"
    ) -> Model:
        tables = [
            f"[outline]\n{outline}",
            f"[holes]\n{holes}" if holes else "",
            f"[film]\n{film}",
            f"[model]\n{model}",
        ]
        return geometry.parse('name = "device"\nsource = "a test"\n' + "\n".join(tables))

    return build


@pytest.fixture
def own_cache(tmp_path: Path) -> Path:
    """A folder for XDG_CACHE_HOME that holds the films solved so far, and no fits."""
    folder = tmp_path / "cache" / "femnl"
    folder.mkdir(parents=True)
    for solved in user_cache_path("femnl").glob("*.n[cp]*"):
        (folder / solved.name).symlink_to(solved)
    return folder.parent


@pytest.fixture
def allow_memory() -> Iterator[Callable[[int], None]]:
    """Allow this process so many bytes of memory, as `ulimit -m` does.

    a limit that Linux tells, but leaves to programs to keep.
    """
    before = resource.getrlimit(resource.RLIMIT_RSS)
    yield lambda size: resource.setrlimit(resource.RLIMIT_RSS, (size, before[1]))
    resource.setrlimit(resource.RLIMIT_RSS, before)


@pytest.fixture(autouse=True)
def _never_at_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let what a command says not depend on how busy the machine of the tests is."""
    monkeypatch.setattr("femnl.cli._output.PROGRESS.first_word", 1e9)
