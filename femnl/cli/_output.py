"""How commands print: tables that copy into a paper, numbers with errors, one JSON object."""

from __future__ import annotations

import json
import logging
import math
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Event, Lock, Thread
from typing import TYPE_CHECKING, Any

import typer

from femnl.cli._format import chosen, render
from femnl.core.errors import one_line
from femnl.core.json_values import json_value

if TYPE_CHECKING:
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

SENTENCE = 40
"""Characters of a cell from which on its column wraps, so that the short ones keep theirs."""
FIRST_WORD = 2.0
"""Seconds after which a command that has said nothing says that it is at work."""
QUIET = 30.0
"""Seconds without a word after which it says so again, where that is not shown on a terminal."""
TICK = 1.0
"""Seconds between looks at the time without a word."""
WIDEST = 120
"""Characters of a step where no terminal tells its width; a command may name a thousand files."""
CLEAR = "\r\x1b[K"  # of a terminal: to the start of the line, and empty it
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


class Printer:
    """Standard output: tables in the chosen style.

    In a style for papers and programs, the words between the tables go to standard error.
    """

    def print(self, what: str | Text | Table | Group) -> None:
        """Print a sentence, a table, or a table under its title.

        A sentence is plain: brackets of a file's text are no markup.
        """
        from rich.console import Console, Group
        from rich.table import Table
        from rich.text import Text

        clear()
        if isinstance(what, str):
            what = Text(one_line(what))
        if chosen.get() == "text":
            # Wide enough for any table where the output is not a terminal.
            Console(highlight=False, width=None if sys.stdout.isatty() else 200).print(what)
        elif isinstance(what, Text):
            note(what.plain)
        else:
            title, body = what.renderables if isinstance(what, Group) else (what.title, what)
            if isinstance(body, Table):
                typer.echo(render(str(title).strip(), body))


def console() -> Printer:
    """Return what commands print on."""
    return Printer()


def note(text: str) -> None:
    """Tell the user something beside the result, in a line on standard error."""
    clear()
    typer.echo(one_line(text), err=True)


class Progress(logging.Handler):
    """What femnl works on: in the last line of a terminal, else in lines of its own now and then.

    A terminal shows each step; the next one, or a result, takes its place. Where there is no
    terminal, the step of the moment is told `first_word` seconds after the begin and then after
    each QUIET seconds. A thread tells it, so that no long step of a solver or a fit is silent.
    tick: seconds between its looks at the time.
    """

    def __init__(self, first_word: float = FIRST_WORD, tick: float = TICK) -> None:
        super().__init__()
        self.first_word = first_word
        self._tick = tick
        self._writing = Lock()
        self._ended = Event()
        self._ended.set()
        self._hushed = False
        self._start("")

    def _start(self, step: str) -> None:
        now = time.monotonic()
        self._step = step
        self._begun = now
        self._heard = now
        self._told_before = False

    @contextmanager
    def watch(self, command: str) -> Iterator[None]:
        """Tell of a command, as it was typed, while it runs."""
        self._start(f"working on {one_line(command)}")
        self._ended = Event()
        watcher = Thread(target=self._watch, args=(self._ended,), daemon=True)
        watcher.start()
        try:
            yield
        finally:
            self._ended.set()
            watcher.join()
            self.heard()

    @contextmanager
    def hush(self) -> Iterator[None]:
        """Tell nothing meanwhile: a bar shows how far the work has come."""
        self._hushed = True
        try:
            yield
        finally:
            self._hushed = False
            self.heard()

    def heard(self) -> None:
        """Take the step off the terminal, and count the time without a word from now on."""
        with self._writing:
            self._heard = time.monotonic()
            if sys.stderr.isatty():
                sys.stderr.write(CLEAR)
                sys.stderr.flush()

    def emit(self, record: logging.LogRecord) -> None:
        """Take note of what the logger femnl.progress tells, and show it on a terminal."""
        self._step = one_line(record.getMessage())
        if sys.stderr.isatty():
            self._tell(0.0)

    def _watch(self, ended: Event) -> None:
        while not ended.wait(self._tick):
            again = self._told_before and not sys.stderr.isatty()
            self._tell(QUIET if again else self.first_word)

    def _tell(self, patience: float) -> None:
        """Tell the step where nothing was told for `patience` seconds."""
        with self._writing:
            now = time.monotonic()
            if self._hushed or self._ended.is_set() or now - self._heard < patience:
                return
            self._heard = now
            self._told_before = True
            lasts = now - self._begun
            since = f" {lasts:.0f} s" if lasts >= self.first_word else ""
            before, after = (CLEAR, "") if sys.stderr.isatty() else ("", "\n")
            step = self._step[: max(_room() - len(f" …{since}"), 0)]
            with suppress(OSError, ValueError):  # where nobody reads any more
                sys.stderr.write(f"{before}{step} …{since}{after}")
                sys.stderr.flush()


def _room() -> int:
    """Return how many characters of standard error are one line.

    A step that a terminal breaks into lines could not be taken off again.
    """
    with suppress(OSError, ValueError):  # no terminal, or one of no known size
        columns = os.get_terminal_size(sys.stderr.fileno()).columns
        return columns - 1 if columns else WIDEST
    return WIDEST


PROGRESS = Progress()


def clear() -> None:
    """Take the step off the terminal before anything else is printed."""
    PROGRESS.heard()


def print_json(value: Any) -> None:
    """Print one JSON object with full precision and nothing else; NaN and infinities as null."""
    clear()
    text = json.dumps(json_value(value), ensure_ascii=False)
    if not text.isprintable():  # JSON itself escapes but the first 32 signs
        text = "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in text)
    typer.echo(text)


def table(title: str, columns: list[str], rows: list[list[str]]) -> Group:
    """Return a plain table under its title: text left, numbers right."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    result = Table(box=None, pad_edge=False, header_style="bold")
    for k, column in enumerate(columns):
        numbers = all(row[k][:1] in "0123456789-−–" for row in rows)
        long = any(len(row[k]) > SENTENCE for row in rows)
        result.add_column(column, justify="right" if numbers else "left", no_wrap=not long)
    for row in rows:
        result.add_row(*(Text(one_line(cell)) for cell in row))  # "[m]" is a unit and no markup
    lead = "\n" * title.startswith("\n")
    return Group(Text(f"{lead}{one_line(title.lstrip())}", style="italic"), result)


def scientific(value: float, digits: int = 4) -> str:
    """Return a number such as 6.93·10⁻³ for 0.00693; plain digits where the exponent is small."""
    if value == 0 or not math.isfinite(value) or 1e-3 <= abs(value) < 1e5:
        plain = f"{value:.{digits}g}"
        return f"{float(plain):.0f}" if "e+" in plain else plain
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa}·10{str(int(exponent)).translate(SUPERSCRIPT)}"
