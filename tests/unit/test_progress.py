"""No command is silent: after two seconds it says what it works on."""

import io
import logging
import sys
import time
from threading import Event

import pytest

from femnl.cli import _output
from femnl.cli._output import CLEAR, Progress, note

SOON = 0.05
STEP = logging.makeLogRecord({"msg": "meshing [b]"})


class Terminal(io.StringIO):
    """A standard error that calls itself a terminal."""

    def isatty(self) -> bool:
        """Return that it is one."""
        return True


@pytest.fixture
def progress(monkeypatch: pytest.MonkeyPatch) -> Progress:
    """Progress that waits hundredths of seconds."""
    found = Progress(first_word=SOON, tick=SOON / 10)
    monkeypatch.setattr(_output, "PROGRESS", found)
    return found


def wait_for(stream: io.StringIO, count: int) -> list[str]:
    """Wait for so many words, at most ten seconds."""
    end = time.monotonic() + 10
    while stream.getvalue().count("…") < count and time.monotonic() < end:
        Event().wait(SOON / 10)
    return stream.getvalue().splitlines()


def test_a_long_step_is_told_once_where_there_is_no_terminal(
    progress: Progress, monkeypatch: pytest.MonkeyPatch
) -> None:
    errors = io.StringIO()
    monkeypatch.setattr(sys, "stderr", errors)
    with progress.watch("femnl fit 'my file.nc'"):
        assert wait_for(errors, 1) == ["working on femnl fit 'my file.nc' … 0 s"]
        Event().wait(4 * SOON)
    assert len(errors.getvalue().splitlines()) == 1, "the next word comes after QUIET seconds"


def test_what_is_said_meanwhile_puts_the_word_off(
    progress: Progress, monkeypatch: pytest.MonkeyPatch
) -> None:
    errors = io.StringIO()
    monkeypatch.setattr(sys, "stderr", errors)
    progress.first_word = 10 * SOON
    with progress.watch("femnl fit f.nc"):
        for _ in range(30):
            Event().wait(SOON / 2)
            note("repaired")
    assert set(errors.getvalue().splitlines()) == {"repaired"}


def test_a_terminal_is_told_again_and_the_line_is_taken_off(
    progress: Progress, monkeypatch: pytest.MonkeyPatch
) -> None:
    errors = Terminal()
    monkeypatch.setattr(sys, "stderr", errors)
    with progress.watch("femnl modes drum"):
        progress.emit(STEP)
        wait_for(errors, 4)
    shown = errors.getvalue().split(CLEAR)
    assert sum(part.startswith("meshing [b] …") for part in shown) >= 3
    assert shown[-1] == ""


def test_a_bar_is_not_disturbed(progress: Progress, monkeypatch: pytest.MonkeyPatch) -> None:
    errors = Terminal()
    monkeypatch.setattr(sys, "stderr", errors)
    with progress.watch("femnl sweep s.toml"), progress.hush():
        progress.emit(STEP)
        Event().wait(4 * SOON)
        assert errors.getvalue() == ""


def test_a_reader_that_has_gone_ends_no_command(
    progress: Progress, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Gone(io.StringIO):
        tried = 0

        def write(self, text: str) -> int:
            self.tried += 1
            raise BrokenPipeError

    errors = Gone()
    monkeypatch.setattr(sys, "stderr", errors)
    with progress.watch("femnl modes drum"):
        end = time.monotonic() + 10
        while not errors.tried and time.monotonic() < end:
            Event().wait(SOON / 10)
    assert errors.tried
