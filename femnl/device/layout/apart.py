"""Readers whose library may end the whole process on a damaged file, in one of their own."""

import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from femnl.core.errors import FemnlError, GeometryError, one_line

T = TypeVar("T")


def apart(path: Path, read: Callable[..., T], *about: object) -> T:
    """Return `read(path, *about)`, computed in a process that may die of the file.

    It is a Python of its own, and no copy of this process, so that no script begins anew in it.

    Args: path: of the file that is read. read: a function of a module; what it is called with and
        what it returns or raises can be pickled.
    Raises: GeometryError where the process dies, as of a damaged file; MemoryError where it is
        killed; else what `read` raises.
    """
    known = os.pathsep.join(place for place in sys.path if place)
    done = subprocess.run(
        [sys.executable, "-P", "-c", f"from {__name__} import serve; serve()"],
        input=pickle.dumps((read, (path, *about))),
        capture_output=True,
        env=os.environ | {"PYTHONPATH": known},
        check=False,
    )
    if done.returncode == -signal.SIGKILL:  # by a system that is short of it
        raise MemoryError
    if done.returncode < 0:
        raise GeometryError(
            one_line(
                f"{path}: not a whole {path.suffix[1:].upper()} file, the library that reads it "
                f"dies of it (signal {-done.returncode}); export it again"
            )
        )
    if done.returncode:
        raise RuntimeError(done.stderr.decode(errors="replace"))
    answer: tuple[T, None] | tuple[None, Exception] = pickle.loads(done.stdout)
    if answer[1] is not None:
        raise answer[1]
    return answer[0]


def serve() -> None:
    """Compute what standard input asks for, and write it, or what was raised, to standard output.

    Standard output is kept for that: what the library prints goes to standard error.
    """
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    read, about = pickle.load(sys.stdin.buffer)
    found, raised = None, None
    try:
        found = read(*about)
    except (FemnlError, MemoryError, OSError) as error:
        raised = error
    with out:
        pickle.dump((found, raised), out)
