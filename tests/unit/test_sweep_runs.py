"""Sweeps on real processes, of this machine and of Dask, that are killed midway.

Nothing finished is lost and nothing is done twice.
"""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from threading import Thread
from typing import IO

import dask
import psutil
import pytest
import xarray as xr

from femnl.cli._main import run as run_command
from femnl.io.results.lines import append
from tests.unit.test_sweep import HEAD, PLAIN

Capture = pytest.CaptureFixture[str]
SHARED = {
    "sweep": ["sweep", "sweep.toml"],
    "diagnose": ["diagnose", "a.csv", "--table", "t.csv"],
}
"""Commands that share out their work."""
Starter = Callable[..., subprocess.Popen[str]]


def sweep_file(folder: Path, points: int) -> Path:
    """A sweep of so many tiny films."""
    (folder / "tiny.toml").write_text(PLAIN, encoding="utf-8")
    path = folder / "sweep.toml"
    path.write_text(
        HEAD + f'[[axis]]\nfilm.stress = {{from = "1 GPa", to = "2 GPa", points = {points}}}\n',
        encoding="utf-8",
    )
    return path


@pytest.fixture
def start() -> Iterator[Starter]:
    """Start Python programs that are killed at the end of the test."""
    environment = os.environ | {
        "PYTHONPATH": str(Path(__file__).parents[2]),
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    with ExitStack() as stack:

        def launch(*words: str, folder: Path) -> subprocess.Popen[str]:
            process = subprocess.Popen(
                [sys.executable, *words],
                cwd=folder,
                env=environment,
                stderr=subprocess.PIPE,
                text=True,
            )
            stack.callback(end, process)
            return process

        yield launch


def end(process: subprocess.Popen[str]) -> None:
    """Kill a process and what it started."""
    if process.poll() is None:
        for child in psutil.Process(process.pid).children(recursive=True):
            child.kill()
        process.kill()
    process.communicate()


def records(store: Path) -> list[bytes]:
    """The whole lines of the store, without its header."""
    lines = store.read_bytes().splitlines(keepends=True) if store.exists() else []
    return [line for line in lines[1:] if line.endswith(b"\n")]


@contextmanager
def patience(seconds: float = 90.0) -> Iterator[Callable[[], None]]:
    """A pause between looks at something, which fails after so many seconds."""
    begun = time.monotonic()

    def pause() -> None:
        if time.monotonic() - begun > seconds:
            pytest.fail("it never came")
        time.sleep(0.02)

    yield pause


def wait_for_records(store: Path, number: int) -> None:
    with patience() as pause:
        while len(records(store)) < number:
            pause()


def check_whole(store: Path, points: int) -> None:
    """Every point is there, once, and solved; tables are written."""
    found = [json.loads(line) for line in records(store)]
    assert len(found) == len({record["key"] for record in found}) == points
    assert not [record for record in found if "error" in record]
    with xr.open_dataset(store.with_suffix(".nc"), engine="h5netcdf") as data:
        stress = data["film.stress"].values
        assert len(stress) == points
        # Of an ideal square membrane f² = σ/2ρL².
        assert data.frequency.values[:, 0] ** 2 / stress == pytest.approx(
            1 / (2 * 1e-4**2 * 3000), rel=1e-5
        )


def finish(process: subprocess.Popen[str]) -> str:
    """What a client says that comes to its end."""
    _, errors = process.communicate(timeout=300)
    assert process.returncode == 0, errors
    return errors


def survive(
    folder: Path,
    points: int,
    options: list[str],
    start: Starter,
    worker: Callable[[subprocess.Popen[str]], int],
) -> None:
    """Sweep, kill one worker, kill the client, and repeat the command."""
    spec = sweep_file(folder, points)
    store = folder / "sweep.jsonl"
    command = ["-m", "femnl", "sweep", spec.name, *options]
    client = start(*command, folder=folder)
    wait_for_records(store, 1)
    os.kill(worker(client), signal.SIGKILL)
    wait_for_records(store, points // 2)
    client.kill()
    client.wait()
    kept = records(store)
    assert len(kept) < points, "the client was killed too late to show anything"
    again = finish(start(*command, folder=folder))
    assert f"{points} points, {len(kept)} of them known" in again
    assert records(store)[: len(kept)] == kept
    check_whole(store, points)


def test_a_sweep_on_processes_survives_a_killed_worker_and_a_killed_client(
    tmp_path: Path, start: Starter
) -> None:
    def oldest(client: subprocess.Popen[str]) -> int:
        return next(
            p.pid
            for p in psutil.Process(client.pid).children()
            if "spawn_main" in " ".join(p.cmdline())
        )

    survive(tmp_path, 8, ["--workers", "2"], start, oldest)


def cluster_of(
    workers: int, folder: Path, start: Starter
) -> tuple[str, list[subprocess.Popen[str]]]:
    """Start a scheduler and workers, each a process of its own.

    The scheduler's address and all processes, the scheduler first.
    """
    note = folder / "scheduler.json"
    words = ("--scheduler-file", str(note), "--no-dashboard")
    processes = [
        start(
            "-m",
            "distributed.cli.dask_scheduler",
            "--host",
            "127.0.0.1",
            "--port",
            "0",
            *words,
            folder=folder,
        )
    ]
    for k in range(workers):
        named = ("--nthreads", "1", "--no-nanny", "--name", str(k))
        processes.append(start("-m", "distributed.cli.dask_worker", *words, *named, folder=folder))
    with patience() as pause:
        # It exists before it is written
        while not note.exists() or not note.read_text():
            pause()
    return json.loads(note.read_text())["address"], processes


@pytest.mark.parametrize("points", [10, pytest.param(120, marks=pytest.mark.slow)])
def test_a_sweep_on_dask_survives_a_killed_worker_and_a_killed_client(
    points: int, tmp_path: Path, start: Starter
) -> None:
    address, (_, first, second) = cluster_of(2, tmp_path, start)
    survive(tmp_path, points, ["--scheduler", address], start, lambda client: first.pid)
    assert first.wait() == -signal.SIGKILL
    assert second.poll() is None


@pytest.mark.slow
def test_a_scheduler_that_dies_is_one_line_and_what_was_solved_stays(
    tmp_path: Path, start: Starter
) -> None:
    address, (scheduler, _) = cluster_of(1, tmp_path, start)
    spec = sweep_file(tmp_path, 400)
    store = tmp_path / "sweep.jsonl"
    client = start("-m", "femnl", "sweep", spec.name, "--scheduler", address, folder=tmp_path)
    wait_for_records(store, 2)
    scheduler.kill()
    _, errors = client.communicate(timeout=60)
    assert client.returncode == 2
    said = [line for line in errors.splitlines() if not line.startswith("working on ")]
    assert said[1:] == [
        f"femnl: --scheduler {address}: the scheduler has gone; start it again and repeat the "
        "command, which goes on from here"
    ]
    assert len(records(store)) >= 2


def test_a_point_that_kills_every_process_fails_alone(tmp_path: Path, start: Starter) -> None:
    spec = sweep_file(tmp_path, 3)
    program = tmp_path / "deadly.py"
    # Stands for a device that takes more memory than there is: the system kills the process,
    # without a word to Python.
    program.write_text(
        "import os, signal, sys\n"
        "from femnl.sweep import processes, solve\n"
        "def serve(connection, settings):\n"
        "    try:\n"
        "        while True:\n"
        "            got = connection.recv()\n"
        "            if got.varied['film.stress'] == '1.5 GPa':\n"
        "                os.kill(os.getpid(), signal.SIGKILL)\n"
        "            connection.send(solve.attempt(got, settings))\n"
        "    except EOFError:\n"
        "        return\n"
        "if __name__ == '__main__':\n"
        "    processes._serve = serve\n"
        "    from femnl.cli import main\n"
        f"    sys.argv = ['femnl', 'sweep', {spec.name!r}, '--workers', '1']\n"
        "    main()\n"
    )
    errors = finish(start(program.name, folder=tmp_path))
    assert errors.count("a worker died (exit code -9) at {'film.stress': '1.5 GPa'}") == 3
    assert "2 points solved, 1 failed" in errors
    found = {
        record["varied"]["film.stress"]: record
        for record in map(json.loads, records(tmp_path / "sweep.jsonl"))
    }
    assert "its process died 3 times" in found["1.5 GPa"]["error"]
    assert {stress for stress, record in found.items() if "results" in record} == {"1 GPa", "2 GPa"}


def test_an_interrupt_ends_workers_and_says_that_the_sweep_goes_on(
    tmp_path: Path, start: Starter
) -> None:
    spec = sweep_file(tmp_path, 400)
    store = tmp_path / "sweep.jsonl"
    client = start("-m", "femnl", "sweep", spec.name, "--workers", "1", folder=tmp_path)
    wait_for_records(store, 1)
    children = psutil.Process(client.pid).children(recursive=True)
    assert children
    client.send_signal(signal.SIGINT)
    _, errors = client.communicate(timeout=90)
    assert client.returncode in (130, -signal.SIGINT)
    assert (
        f"{len(records(store))} of 400 points are kept; the same command goes on from here"
        in errors
    )
    assert errors.endswith("femnl: interrupted; nothing was left half-written\n")
    assert "Traceback" not in errors
    psutil.wait_procs(children, timeout=30)
    assert not [child for child in children if child.is_running()]


def test_an_interrupt_while_a_point_is_written_counts_it_as_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    def interrupted(file: IO[bytes], record: dict[str, object]) -> None:
        append(file, record)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("femnl.sweep.store.append", interrupted)
    sweep_file(tmp_path, 3)
    with pytest.raises(KeyboardInterrupt):
        run_command(["sweep", "sweep.toml", "--workers", "1"])
    assert len(records(tmp_path / "sweep.jsonl")) == 1
    assert "1 of 3 points are kept; the same command goes on from here" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["sweep", "diagnose"])
def test_a_scheduler_that_is_not_there_is_one_line_and_leaves_nothing(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    sweep_file(tmp_path, 3)
    (tmp_path / "a.csv").write_text("f,Q\n1,2\n", encoding="utf-8")
    before = sorted(tmp_path.iterdir())
    began = time.monotonic()
    for address in ("tcp://127.0.0.1:9", "127.0.0.1:9"):
        assert run_command([*SHARED[command], "--scheduler", address]) == 2
        assert capsys.readouterr().err == (
            f"femnl: --scheduler {address}: no Dask scheduler answers (Connection refused); start "
            "one with `dask scheduler`, or check the address\n"
        )
    assert time.monotonic() - began < 10, "Dask, which waits for 30 s, is not asked"
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:port", "tcp://127.0.0.1:99999", ":"])
def test_an_address_that_is_none_is_one_line(
    address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    sweep_file(tmp_path, 3)
    assert run_command(["sweep", "sweep.toml", "--scheduler", address]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"femnl: --scheduler {address}: no Dask scheduler answers (")


@pytest.mark.parametrize("says", [b"", b"SSH-2.0-OpenSSH\r\n"], ids=["nothing", "SSH"])
@pytest.mark.parametrize("command", ["sweep", "diagnose"])
def test_what_listens_and_is_no_scheduler_is_one_line(
    command: str,
    says: bytes,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Capture,
) -> None:
    """Dask itself would wait for it without end."""
    monkeypatch.chdir(tmp_path)
    sweep_file(tmp_path, 3)
    (tmp_path / "a.csv").write_text("f,Q\n1,2\n", encoding="utf-8")
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "1s"}),
        socket.create_server(("127.0.0.1", 0)) as server,
    ):
        Thread(target=greet, args=(server, says), daemon=True).start()
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        assert run_command([*SHARED[command], "--scheduler", address]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    why = "what listens there is none" if says else "silent for 1 s"
    assert line == (
        f"femnl: --scheduler {address}: no Dask scheduler answers ({why}); start one with "
        "`dask scheduler`"
    )


def greet(server: socket.socket, says: bytes) -> None:
    """Say something to all who come, and keep their connections open."""
    held = []
    with suppress(OSError):  # the server is closed
        while True:
            connection, _ = server.accept()
            connection.sendall(says)
            held.append(connection)
