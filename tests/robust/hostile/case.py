"""One hostile case, run in a process of its own under limits, and what it came to."""

import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from stat import S_ISREG

import numpy as np

SECONDS = 60
"""Processor time that a case may take without a word; more is a hang."""
PATIENCE = 75
"""Processor time after which a case is ended though it tells what it does."""
WALL = 150.0
"""Seconds after which a case is ended that takes no processor time."""
MEBIBYTES = 2048
"""Resident memory that a case may take; no case holds more than 200 MiB of data."""
ADDRESS = 6 * 2**30
"""Address space, which keeps a case from taking the machine down."""
LONGEST = 2000
"""Characters of a line that a user is shown."""
STRANGE = re.compile(r"^\w*(Error|Exception|Warning)\b|Warning: |HDF5-DIAG|^Error")
"""Lines that speak of a program's inside and not of what a user can mend."""
UNSAFE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\udc80-\udcff]")
"""What no terminal may get: control characters, escapes and overrides of direction."""

SHELL = "!"
"""The first of two words, of which the second is a line for a shell."""

Make = Callable[[np.random.Generator, Path], list[str]]
"""Writes the files of a case into a folder and returns the words of the command."""


@dataclass(frozen=True)
class Result:
    """What a case came to; `faults` is empty where all is well."""

    kind: str
    seed: int
    words: tuple[str, ...]
    status: int
    seconds: float
    mebibytes: float
    faults: tuple[str, ...]
    shown: str


def run_case(kind: str, seed: int, make: Make, cache: Path) -> Result:
    """Run one case of a class; a seed makes the same case each time."""
    with tempfile.TemporaryDirectory(prefix="hostile-") as name:
        folder = Path(name) / "work"
        folder.mkdir()
        rng = np.random.default_rng([seed, *kind.encode()])
        words = make(rng, folder)
        out = Path(name) / "out"
        err = Path(name) / "err"
        began = time.monotonic()
        given = {path: path.lstat().st_ino for path in folder.rglob("*")}
        child = os.fork()
        if child == 0:
            _serve(words, folder, out, err, cache)
        status, usage, hung = _wait(child, began)
        seconds = usage.ru_utime + usage.ru_stime
        memory = usage.ru_maxrss / 1024
        encoding = "latin-1" if "PYTHONIOENCODING=latin-1" in words[-1] else "utf-8"
        told = err.read_text(encoding=encoding, errors="surrogateescape")
        said = out.read_text(encoding=encoding, errors="surrogateescape")
        heard = words[0] != SHELL or "2>" not in words[1]
        faults = _faults(status, told, said, memory, seconds, hung=hung, heard=heard)
        made = [path for path in folder.rglob("*") if given.get(path) != path.lstat().st_ino]
        if any(_open_to_others(path) for path in made):
            faults = (*faults, "umask")
        _clear(folder)
    return Result(kind, seed, tuple(words), status, seconds, memory, faults, told[-1500:])


def _open_to_others(path: Path) -> bool:
    """Whether a file is readable by others, whom the umask shuts out."""
    mode = path.lstat().st_mode
    return S_ISREG(mode) and bool(mode & 0o077)


def _clear(folder: Path) -> None:
    """Make what a case has locked removable."""
    for path in [folder, *folder.rglob("*")]:
        if path.is_dir() and not path.is_symlink():
            path.chmod(0o700)
    shutil.rmtree(folder)


def _serve(words: list[str], folder: Path, out: Path, err: Path, cache: Path) -> None:
    """Run the command in this process, which ends with it."""
    status = 1
    try:
        os.setsid()
        for number, path in ((1, out), (2, err)):
            with path.open("wb") as stream:
                os.dup2(stream.fileno(), number)
        sys.stdout = os.fdopen(1, "w", encoding="utf-8")
        sys.stderr = os.fdopen(2, "w", encoding="utf-8", errors="backslashreplace")
        os.chdir(folder)
        os.umask(0o077)
        os.environ["XDG_CACHE_HOME"] = str(cache)
        resource.setrlimit(resource.RLIMIT_CPU, (PATIENCE, PATIENCE + 5))
        resource.setrlimit(resource.RLIMIT_AS, (ADDRESS, ADDRESS))
        if words[0] == SHELL:
            os.execvp("sh", ["sh", "-c", words[1]])
        from femnl.cli import main

        sys.argv = ["femnl", *words]
        main()
    except SystemExit as error:
        status = error.code if isinstance(error.code, int) else 1
    finally:
        if sys.exc_info()[0] is not None:  # what a user would see is what is looked for
            traceback.print_exc()
        with suppress(OSError, ValueError):
            sys.stderr.flush()
        os._exit(status)


def _wait(child: int, began: float) -> tuple[int, resource.struct_rusage, bool]:
    """Wait for a process, at most WALL seconds; its status, what it used, and whether it hung."""
    hung = False
    while True:
        pid, raw, usage = os.wait4(child, os.WNOHANG)
        if pid:
            break
        if time.monotonic() - began > WALL:
            hung = True
            os.killpg(child, signal.SIGKILL)
            _, raw, usage = os.wait4(child, 0)
            break
        time.sleep(0.01)
    with suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)  # workers that it left
    status = os.waitstatus_to_exitcode(raw)
    return status, usage, hung or status in (-signal.SIGXCPU, -signal.SIGKILL)


def _faults(
    status: int, told: str, said: str, memory: float, seconds: float, *, hung: bool, heard: bool
) -> tuple[str, ...]:
    """Return what is wrong with how a command ended; heard: whether its standard error is kept."""
    found = []
    if "Traceback" in told or "Traceback" in said:
        found.append("traceback")
    elif seconds > SECONDS and not told:
        found.append("hang")
    elif hung:
        found.append("slow" if status == -signal.SIGXCPU else "hang")
    elif status not in (0, 2):
        found.append(f"status {status}")
    if "breaks down on these numbers" in told:
        found.append("net")
    if memory > MEBIBYTES or "the memory is full" in told:
        found.append("memory")
    if "traceback" in found:
        return tuple(found)
    lines = told.split("\n")
    refusals = [line for line in lines if line.startswith("femnl: ")]
    unsaid = heard and status == 2 and len(refusals) != 1
    if unsaid or any(STRANGE.search(line) for line in lines):
        found.append("lines")
    if any(len(line) > LONGEST for line in lines):
        found.append("long")
    if UNSAFE.search(told) or UNSAFE.search(said):
        found.append("control")
    return tuple(found)
