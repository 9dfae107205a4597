"""Whatever befalls the disk or the process, a file is whole or as it was before.

Done to it for real, not imagined.
"""

import os
import random
import re
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from shutil import which

import numpy as np
import pytest

from femnl.cli._main import run
from femnl.core.errors import ParameterError
from femnl.io import measurement
from femnl.io.results.atomic import write_whole
from femnl.io.results.cache import kept

DRUM = ["modes", "circle", "--count", "1", "--resolution", "0.5"]

STEP = re.compile(r".* … \d+ s")
"""What a busy machine has time to tell of the step that it is at."""


def femnl(
    *words: str, folder: Path, before: Callable[[], None] | None = None, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own, its cache in the folder."""
    known = (
        os.environ
        | {"XDG_CACHE_HOME": str(folder / "cache"), "PYTHONPATH": str(Path(__file__).parents[2])}
        | environment
    )
    command = [sys.executable, "-m", "femnl", *words]
    return subprocess.run(
        command,
        cwd=folder,
        env=known,
        preexec_fn=before,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def traces(value: float) -> str:
    """A program that writes one large measurement file for ever, all its voltages the same."""
    return (
        "import numpy as np\nfrom pathlib import Path\nfrom femnl import measurement\n"
        f"data = measurement.trace(np.arange(2**20) * 1e-6, np.full((1, 2**20), {value}), "
        "drive_frequency=[1e6])\n"
        "tree = measurement.bundle({'trace': data})\nPath('ready').touch()\n"
        "while True:\n    measurement.write(tree, 'shared.nc')\n"
    )


def start(program: str, folder: Path) -> subprocess.Popen[bytes]:
    """Start a program in a folder."""
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    return subprocess.Popen([sys.executable, "-c", program], cwd=folder, env=environment)


def wait_for(path: Path) -> None:
    """Wait until a file is there."""
    for _ in range(600):
        if path.exists():
            return
        time.sleep(0.05)
    pytest.fail(f"{path} never came")


def test_a_file_whose_writer_is_killed_is_whole(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    process = start(traces(1.0), tmp_path)
    wait_for(tmp_path / "shared.nc")
    for _ in range(6):
        time.sleep(rng.uniform(0.01, 0.3))
        process.send_signal(signal.SIGSTOP)
        stored = measurement.read(tmp_path / "shared.nc")["trace"].to_dataset()
        assert np.all(stored.voltage.values == 1.0)
        process.send_signal(signal.SIGCONT)
    process.kill()
    process.wait()
    assert np.all(
        measurement.read(tmp_path / "shared.nc")["trace"].to_dataset().voltage.values == 1.0
    )


def test_two_writers_of_one_file_never_mix(tmp_path: Path) -> None:
    writers = [start(traces(value), tmp_path) for value in (1.0, 2.0)]
    wait_for(tmp_path / "shared.nc")
    seen = set()
    for _ in range(200):
        values = np.unique(
            measurement.read(tmp_path / "shared.nc")["trace"].to_dataset().voltage.values
        )
        assert len(values) == 1
        seen.add(float(values[0]))
        if len(seen) == 2:
            break
    for writer in writers:
        writer.kill()
        writer.wait()
    assert seen == {1.0, 2.0}


def test_a_full_disk_leaves_the_old_file_and_says_so(tmp_path: Path) -> None:
    (tmp_path / "modes.nc").write_text("of yesterday")

    def small_files_only() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))

    done = femnl(*DRUM, "--no-cache", "--out", "modes.nc", folder=tmp_path, before=small_files_only)
    assert done.returncode == 2, done.stderr
    (line,) = [line for line in done.stderr.splitlines() if not STEP.match(line)]
    assert line.startswith("femnl: modes.nc: writing failed")
    assert (tmp_path / "modes.nc").read_text() == "of yesterday"
    assert [path.name for path in tmp_path.iterdir()] == ["modes.nc"]


def test_a_cache_without_room_costs_a_warning_and_nothing_else(tmp_path: Path) -> None:
    def small_files_only() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))

    done = femnl(*DRUM, "--json", folder=tmp_path, before=small_files_only)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith('{"geometry": "circle"')
    assert "a result was not kept in the cache" in done.stderr
    assert "Traceback" not in done.stderr
    assert not list((tmp_path / "cache" / "femnl").glob("modes*"))


FULL = (
    "femnl: output: No space left on device; check the path, its permissions and the room on "
    "the disk"
)


@pytest.mark.parametrize(
    "words",
    [
        ["--help"],
        ["--version"],
        ["geometries"],
        ["geometries", "--json"],
        ["effects"],
        ["effects", "static_bow"],
    ],
    ids=" ".join,
)
def test_output_onto_a_full_disk_is_one_line(words: list[str], tmp_path: Path) -> None:
    status, errors = onto_full("stdout", words, tmp_path)
    assert status == 2
    assert [line for line in errors.splitlines() if not line.startswith("working on ")] == [FULL]


@pytest.mark.parametrize("words", [["modes", "squar"], ["show", "none.nc"]], ids=" ".join)
def test_a_refusal_onto_a_full_disk_keeps_its_status(words: list[str], tmp_path: Path) -> None:
    assert onto_full("stderr", words, tmp_path) == (2, "")


def onto_full(stream: str, words: list[str], folder: Path) -> tuple[int, str]:
    """Run femnl with one stream on a full disk; its status, and what the other says."""
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    with Path("/dev/full").open("w") as full:
        process = subprocess.Popen(
            [sys.executable, "-m", "femnl", *words],
            cwd=folder,
            env=environment,
            stdout=full if stream == "stdout" else subprocess.PIPE,
            stderr=full if stream == "stderr" else subprocess.PIPE,
            text=True,
        )
        out, errors = process.communicate(timeout=120)
    return process.returncode, out or errors or ""


def test_a_folder_that_must_not_be_written_is_one_line_before_anything_is_solved(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "locked"
    folder.mkdir()
    folder.chmod(0o555)
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
    if os.getuid() == 0:  # who may write everywhere, unless that right is taken away
        if which("setpriv") is None:
            pytest.skip("the tests run as root, and there is no setpriv to take its rights away")
        command = ["setpriv", "--bounding-set=-dac_override", "--inh-caps=-dac_override", *command]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    began = time.monotonic()
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert (
        done.stderr
        == "femnl: m.nc: cannot write there; name a file in a folder that exists and is writable\n"
    )
    assert done.returncode == 2
    assert time.monotonic() - began < 30


class TestCache:
    path: Path

    @pytest.fixture(autouse=True)
    def _folder(self, tmp_path: Path) -> None:
        self.path = tmp_path / "cache" / "result.npz"

    def ask(self, value: float) -> float:
        """Take the value from the cache, or put it there."""

        def read() -> float:
            with np.load(self.path) as stored:
                return float(stored["value"])

        return kept(self.path, read, lambda: value, lambda file, found: np.savez(file, value=found))

    def test_it_keeps_what_was_solved_first(self) -> None:
        assert [self.ask(1.0), self.ask(2.0)] == [1.0, 1.0]

    def test_every_flipped_bit_is_noticed_and_mended(
        self, caplog: pytest.LogCaptureFixture
    ) -> None:
        self.ask(1.0)
        whole = self.path.read_bytes()
        for at in range(0, len(whole), 7):
            self.path.write_bytes(whole[:at] + bytes([whole[at] ^ 16]) + whole[at + 1 :])
            assert self.ask(2.0) == 2.0, at
            assert "not as it was written" in caplog.text
            caplog.clear()
            assert self.ask(3.0) == 2.0
            assert not caplog.text

    @pytest.mark.parametrize(
        "content",
        [
            b"",
            b"PK",
            b"\x89HDF\r\n\x1a\n" + bytes(5000),
            random.Random(4).randbytes(31),
            bytes(10**6),
        ],
        ids=["empty", "zip", "hdf5", "noise", "zeros"],
    )
    def test_a_file_of_another_kind_is_solved_anew(
        self, content: bytes, caplog: pytest.LogCaptureFixture
    ) -> None:
        self.path.parent.mkdir()
        self.path.write_bytes(content)
        assert self.ask(2.0) == 2.0
        assert "solved anew" in caplog.text

    def test_a_file_in_the_place_of_its_folder_costs_a_warning(
        self, caplog: pytest.LogCaptureFixture
    ) -> None:
        self.path.parent.write_text("in the way")
        assert self.ask(2.0) == 2.0
        assert "not kept in the cache" in caplog.text
        assert self.path.parent.read_text() == "in the way"


def test_a_pickle_in_the_cache_is_never_run(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    cache = TestCache()
    cache.path = tmp_path / "result.npz"

    class Evil:
        def __reduce__(self) -> tuple[Callable[[str], None], tuple[str]]:
            return os.mkdir, (str(tmp_path / "owned"),)

    kept(
        cache.path,
        lambda: None,
        lambda: None,
        lambda file, _: np.savez(file, value=np.array([Evil()])),
    )
    assert cache.ask(2.0) == 2.0
    assert "solved anew" in caplog.text
    assert not (tmp_path / "owned").exists()


KILLED = """import os, signal
from pathlib import Path
from femnl.io.results.atomic import write_whole

def write(part):
    part.write_text("half of it")
    os.kill(os.getpid(), signal.SIGKILL)

write_whole(Path("x.nc"), write)
"""


def test_what_a_killed_writer_left_goes_with_the_next_file_and_what_is_written_stays(
    tmp_path: Path,
) -> None:
    start(KILLED, tmp_path).wait()
    (left,) = tmp_path.iterdir()
    os.utime(left, (0, 0))

    def write(part: Path) -> None:
        os.utime(part.parent, (0, 0))
        write_whole(tmp_path / "y.nc", lambda other: other.write_text("whole"))
        part.write_text("whole too")

    write_whole(tmp_path / "x.nc", write)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x.nc", "y.nc"]


def test_a_name_that_is_a_folder_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "x.nc").mkdir()
    with pytest.raises(ParameterError, match="nothing was changed"):
        write_whole(tmp_path / "x.nc", lambda file: None)
    assert [path.name for path in tmp_path.iterdir()] == ["x.nc"]


def test_a_memory_that_is_too_small_is_said_before_it_starts(
    capsys: pytest.CaptureFixture[str],
) -> None:
    began = time.monotonic()
    assert (
        run(
            [
                "modes",
                "circle",
                "--symmetry",
                "full",
                "--resolution",
                "20",
                "--count",
                "100000",
                "--no-cache",
            ]
        )
        == 2
    )
    line = capsys.readouterr().err
    assert line.startswith("femnl: ")
    assert line.endswith("lower the resolution\n")
    assert " GiB of memory, and this machine has " in line
    assert time.monotonic() - began < 30
