"""A run gives the same answer however many threads work on it, however often.

And it stops when it is told to.
"""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]


def environment(folder: Path, threads: int = 1) -> dict[str, str]:
    """The process's environment with its own cache and so many threads."""
    counts = {f"{library}_NUM_THREADS": str(threads) for library in ("OMP", "OPENBLAS", "MKL")}
    return os.environ | counts | {"XDG_CACHE_HOME": str(folder / "cache"), "PYTHONPATH": str(ROOT)}


def solve(folder: Path, threads: int) -> str:
    """The modes of a drum with holes, as JSON."""
    words = ["modes", "circle", "--count", "4", "--no-cache", "--json"]
    command = [sys.executable, "-m", "femnl", *words]
    return subprocess.run(
        command, env=environment(folder, threads), capture_output=True, text=True, check=True
    ).stdout


def test_a_rerun_gives_the_same_bits_and_more_threads_the_same_numbers(tmp_path: Path) -> None:
    first = solve(tmp_path, 1)
    again = solve(tmp_path, 1)
    threaded = solve(tmp_path, 2)
    assert first == again
    one, two = (json.loads(text)["modes"] for text in (first, threaded))
    for name in ("frequency", "effective_mass", "k3", "alpha"):
        np.testing.assert_allclose(
            [mode[name] for mode in one], [mode[name] for mode in two], rtol=1e-9
        )


@pytest.mark.parametrize(
    ("text", "status"), [("argument 3: KeyboardInterrupt: ", 130), ("argument 3: TypeError: ", 1)]
)
def test_an_interrupt_while_an_argument_is_converted_is_one_line(
    tmp_path: Path, text: str, status: int
) -> None:
    program = f"""
import ctypes, sys, types
import femnl.cli

def run(words):
    raise ctypes.ArgumentError({text!r})

sys.modules["femnl.cli._main"] = types.SimpleNamespace(run=run)
femnl.cli.main()
"""
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=environment(tmp_path),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == status
    one_line = done.stderr == "femnl: interrupted; nothing was left half-written\n"
    assert one_line == (status == 130)


@pytest.mark.parametrize("seconds", [1.5, pytest.param(9.0, marks=pytest.mark.slow)])
def test_an_interrupt_is_one_line_and_status_130(tmp_path: Path, seconds: float) -> None:
    command = [
        sys.executable,
        "-m",
        "femnl",
        "modes",
        "square-270um-perforated",
        "--symmetry",
        "full",
        "--out",
        "m.nc",
    ]
    process = subprocess.Popen(
        command, cwd=tmp_path, env=environment(tmp_path), stderr=subprocess.PIPE, text=True
    )
    time.sleep(seconds)
    process.send_signal(signal.SIGINT)
    told = time.monotonic()
    _, errors = process.communicate(timeout=60)
    assert time.monotonic() - told < 20
    # Python may end itself by the signal; shells show 130 for either
    assert process.returncode in (130, -signal.SIGINT)
    *steps, last = errors.splitlines()
    assert last == "femnl: interrupted; nothing was left half-written"
    assert all(" … " in step for step in steps)
    assert not list(tmp_path.glob("*.nc"))


@pytest.mark.parametrize(
    ("words", "status"),
    [
        ("geometries", 0),
        ("modes square-270um --resolution 0.2", 0),
        ("geometry check missing.gds", 2),
    ],
)
def test_a_reader_that_leaves_early_is_no_failure(words: str, status: int, tmp_path: Path) -> None:
    command = f"set -o pipefail; {sys.executable} -m femnl {words} 2>&1 | true"
    done = subprocess.run(
        ["bash", "-c", command],
        env=environment(tmp_path),
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (status, "")
