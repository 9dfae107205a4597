"""The command line: one file a command, found by its name; parsing and printing only."""

import os
import signal
import sys
from importlib import import_module
from io import TextIOWrapper
from threading import Thread
from time import sleep

from femnl.core.errors import leave_out_warnings

__all__ = ["main"]

INTERRUPTED = 130
GRACE = 2.0  # seconds to leave by the front door
LINE = "femnl: interrupted; nothing was left half-written\n"


def main() -> None:
    """Run femnl on the words of the command line and exit.

    0 done, 2 the request cannot be met, 130 interrupted.
    """
    _need_streams()
    leave_out_warnings()
    Thread(target=_end_if_interrupt_unheard, args=(_signals(),), daemon=True).start()
    try:
        # Loaded here, so that an interrupt while libraries load is met like any other.
        status = import_module("femnl.cli._main").run(sys.argv[1:] or ["--help"])
    except (KeyboardInterrupt, Exception) as error:
        if not _is_interrupt(error):
            raise
        sys.stderr.write(LINE)
        status = INTERRUPTED
    sys.exit(status)


def _is_interrupt(error: BaseException) -> bool:
    """Whether an exception is an interrupt.

    One that comes while ctypes converts an argument, as of a mesher's function, is an ArgumentError
    whose text names it.
    """
    return isinstance(error, KeyboardInterrupt) or "KeyboardInterrupt" in str(error)


def _need_streams() -> None:
    """Let output that is closed go nowhere, and show signs that its encoding lacks as escapes.

    A file that is opened must not become standard output, where a library may print.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            # The lowest free number, which is that of the stream
            nowhere = os.open(os.devnull, os.O_RDWR)
            setattr(sys, name, os.fdopen(nowhere, mode))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _signals() -> int:
    """Return a pipe to which the interpreter writes every signal as it comes."""
    end, start = os.pipe()
    os.set_blocking(start, False)
    signal.set_wakeup_fd(start)
    return end


def _end_if_interrupt_unheard(signals: int) -> None:
    """End the process with one line if an interrupt has not ended it after `GRACE` seconds.

    Python hears an interrupt only between its own steps, and a mesher or solver may take minutes
    for one.

    Args: signals: descriptor of the pipe that tells of interrupts.
    """
    os.read(signals, 1)
    sleep(GRACE)
    sys.stderr.write(LINE)
    sys.stderr.flush()
    os._exit(INTERRUPTED)
