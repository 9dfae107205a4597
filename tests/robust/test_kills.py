"""Commands that are killed at random moments: nothing stays behind, and the next run is as any."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from femnl.io import measurement
from tests.robust.hostile.files import drum

ROOT = Path(__file__).parents[2]
MOMENTS = {signal.SIGKILL: 20, signal.SIGTERM: 5, signal.SIGINT: 5}
ORPHANS = 5.0
"""Seconds after which no process of a killed command is left."""
SWEEP = """geometry = "drum.toml"
modes = 2
resolution = 0.3
[[axis]]
film.stress = ["1 GPa", "1.1 GPa", "1.2 GPa"]
"""


@dataclass(frozen=True)
class Command:
    """A command: its words, and the files that a whole run leaves beside those it is given."""

    words: tuple[str, ...]
    leaves: frozenset[str]


COMMANDS = {
    "modes": Command(
        ("modes", "drum.toml", "-n", "2", "--json", "--out", "m.nc"), frozenset({"m.nc"})
    ),
    "sweep": Command(
        ("sweep", "s.toml", "--workers", "2", "--json"),
        frozenset({"s.jsonl", "s.csv", "s.nc"}),
    ),
    "diagnose": Command(
        ("diagnose", "f.nc", "--workers", "2", "--json", "--out", "o"),
        frozenset({"o", "o/diagnosis.json", "o/report.html", "o/contributions.csv"}),
    ),
}


def prepare(folder: Path) -> None:
    """Write the files of all commands."""
    drum(folder)
    (folder / "s.toml").write_text(SWEEP, encoding="utf-8")
    rng = np.random.default_rng(5)
    pressure = np.linspace(1, 100, 24)
    quality = 1e5 / (1 + pressure / 30) * (1 + 0.01 * rng.normal(size=24))
    data = measurement.series(
        {"pressure": pressure}, quality_factor=quality, quality_factor_sd=0.01 * quality
    )
    measurement.write(measurement.bundle({"q": data}, geometry="drum.toml"), folder / "f.nc")


def start(command: Command, folder: Path) -> subprocess.Popen[str]:
    """Start a command in a session of its own, its cache in the folder."""
    environment = os.environ | {
        "XDG_CACHE_HOME": str(folder / "cache"),
        "PYTHONPATH": str(ROOT),
        "OMP_NUM_THREADS": "1",
    }
    return subprocess.Popen(
        [sys.executable, "-m", "femnl", *command.words],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def alive(session: int) -> list[int]:
    """Return the processes of a session that have not ended."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, *numbers = path.read_text().rpartition(")")[2].split()
        except OSError:  # it ended meanwhile
            continue
        if int(numbers[2]) == session and state != "Z":
            found.append(int(path.parent.name))
    return found


def ended(session: int) -> float:
    """Wait until all processes of a session have ended; the seconds that took, some at most."""
    began = time.monotonic()
    while alive(session) and time.monotonic() - began < 2 * ORPHANS:
        time.sleep(0.05)
    return time.monotonic() - began


def answer(text: str, folder: Path) -> object:
    """Return what a command printed, or the results that a sweep stored, whose times differ."""
    store = folder / "s.jsonl"
    if not store.exists():
        return json.loads(text)
    lines = [json.loads(line) for line in store.read_text(encoding="utf-8").splitlines()]
    return {line["key"]: line["results"] for line in lines[1:]}


def held(folder: Path) -> set[str]:
    """Return the names of all files but those of the cache."""
    names = {str(path.relative_to(folder)) for path in folder.rglob("*")}
    return {name for name in names if not name.startswith("cache")}


SLOW = """import os
import time

if "SLOW" in os.environ:
    time.sleep(30)


def serve(connection):
    pass
"""
PARENT = """import os
import time
import slow
from femnl.core.processes import Worker

os.environ["SLOW"] = "in processes that are started from now on"
worker = Worker(slow.serve)
print("started", flush=True)
time.sleep(60)
"""


def test_a_process_that_still_loads_what_it_serves_ends_with_its_parent(tmp_path: Path) -> None:
    (tmp_path / "slow.py").write_text(SLOW, encoding="utf-8")
    with subprocess.Popen(
        [sys.executable, "-c", PARENT],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": f"{ROOT}:{tmp_path}"},
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == "started\n"
        time.sleep(2)  # until the process has begun
        assert len(alive(parent.pid)) >= 2
        parent.kill()
    assert ended(parent.pid) < ORPHANS


@pytest.mark.slow
@pytest.mark.parametrize("number", MOMENTS, ids=lambda number: number.name)
@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_that_is_killed_leaves_nothing_behind_and_then_gives_the_same(
    name: str, number: signal.Signals, tmp_path: Path
) -> None:
    command = COMMANDS[name]
    rng = random.Random(f"{name} {number}")
    whole = tmp_path / "whole"
    whole.mkdir()
    prepare(whole)
    given = held(whole)
    began = time.monotonic()
    process = start(command, whole)
    expected = answer(process.communicate(timeout=300)[0], whole)
    lasts = time.monotonic() - began
    assert held(whole) - given <= command.leaves
    for moment in range(MOMENTS[number]):
        folder = tmp_path / f"moment-{moment}"
        folder.mkdir()
        prepare(folder)
        process = start(command, folder)
        time.sleep(rng.uniform(0, lasts))
        process.send_signal(number)
        process.communicate(timeout=60)
        assert ended(process.pid) < ORPHANS, moment
        new = held(folder) - given
        # What was being written at that moment goes with the next file
        assert {name for name in new if ".femnl-" not in name} <= command.leaves, moment
        again = start(command, folder)
        out, errors = again.communicate(timeout=300)
        assert again.returncode == 0, errors
        assert answer(out, folder) == expected, moment
        assert held(folder) - given <= command.leaves
        kept = [path.name for path in (folder / "cache" / "femnl").rglob("*")]
        assert all(path.endswith((".nc", ".npz")) for path in kept), kept
