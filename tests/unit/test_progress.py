"""No command is silent: after two seconds it says what it works on."""

import logging
import os
import termios
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, suppress
from pathlib import Path
from threading import Event

import pytest

from femnl.cli._output import CLEAR, FIRST_WORD, PROGRESS, Progress, note

SOON = 0.05
STEP = logging.makeLogRecord({"msg": "meshing [b]"})
Seen = Callable[[], str]


@pytest.fixture
def progress() -> Progress:
    """Progress that waits hundredths of seconds."""
    return Progress(first_word=SOON, tick=SOON / 10)


@contextmanager
def in_a_file(path: Path) -> Iterator[Seen]:
    """Let standard error be a file, and show what comes to it."""
    with path.open("w", encoding="utf-8") as stream, redirect_stderr(stream):
        yield lambda: path.read_text(encoding="utf-8")


@contextmanager
def on_a_terminal(columns: int = 80) -> Iterator[Seen]:
    """Let standard error be a terminal, and show what comes to it."""
    ours, theirs = os.openpty()
    termios.tcsetwinsize(theirs, (24, columns))
    os.set_blocking(ours, False)
    shown = ""

    def seen() -> str:
        nonlocal shown
        with suppress(BlockingIOError):  # nothing new
            shown += os.read(ours, 1 << 16).decode()
        return shown

    with os.fdopen(theirs, "w", encoding="utf-8") as stream, redirect_stderr(stream):
        yield seen
    os.close(ours)


def wait_for(seen: Seen, count: int) -> list[str]:
    """Wait for so many words, at most ten seconds."""
    end = time.monotonic() + 10
    while seen().count("…") < count and time.monotonic() < end:
        Event().wait(SOON / 10)
    return seen().splitlines()


def test_a_long_step_is_told_once_where_there_is_no_terminal(
    progress: Progress, tmp_path: Path
) -> None:
    with in_a_file(tmp_path / "errors") as seen:
        with progress.watch("femnl fit 'my file.nc'"):
            assert wait_for(seen, 1) == ["working on femnl fit 'my file.nc' … 0 s"]
            Event().wait(4 * SOON)
        assert len(seen().splitlines()) == 1, "the next word comes after QUIET seconds"


def test_what_is_said_meanwhile_puts_the_word_off(tmp_path: Path) -> None:
    PROGRESS.first_word = FIRST_WORD  # for this test, where others never wait for it
    with in_a_file(tmp_path / "errors") as seen, PROGRESS.watch("femnl fit f.nc"):
        for _ in range(6):
            Event().wait(FIRST_WORD / 4)
            note("repaired")
        assert set(seen().splitlines()) == {"repaired"}


def test_a_terminal_is_told_again_and_the_line_is_taken_off(progress: Progress) -> None:
    with on_a_terminal() as seen:
        with progress.watch("femnl modes drum"):
            progress.emit(STEP)
            wait_for(seen, 4)
        shown = seen().split(CLEAR)
    assert sum(part.startswith("meshing [b] …") for part in shown) >= 3
    assert shown[-1] == ""


def test_a_command_of_many_files_stays_in_one_line(progress: Progress, tmp_path: Path) -> None:
    command = f"femnl diagnose {' '.join(f'record_{k}.txt' for k in range(50))} --table t.csv"
    with on_a_terminal(columns=60) as seen, progress.watch(command):
        wait_for(seen, 2)
        shown = seen().split(CLEAR)
    assert max(len(part) for part in shown) == 59
    assert shown[-1].startswith("working on femnl diagnose record_0.txt")
    with in_a_file(tmp_path / "errors") as seen, progress.watch(command):
        (line,) = wait_for(seen, 1)
    assert len(line) == 120


def test_a_bar_is_not_disturbed(progress: Progress) -> None:
    with on_a_terminal() as seen, progress.watch("femnl sweep s.toml"), progress.hush():
        progress.emit(STEP)
        Event().wait(4 * SOON)
        assert seen() == ""


def test_a_reader_that_has_gone_ends_no_command(progress: Progress) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    stream = os.fdopen(writer, "w", encoding="utf-8")
    with redirect_stderr(stream), progress.watch("femnl modes drum"):
        Event().wait(10 * SOON)
    with pytest.raises(BrokenPipeError):  # what was told is still to be written
        stream.close()
