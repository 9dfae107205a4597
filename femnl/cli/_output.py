"""How commands print: tables that copy into a paper, numbers with errors, one JSON object."""

from __future__ import annotations

import json
import logging
import math
import sys
import time
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
QUIET = 30.0
"""Seconds without a word where progress is not shown on a terminal."""
CLEAR = "\r\x1b[K"  # of a terminal: to the start of the line, and empty it
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


class Printer:
    """Standard output: tables in the chosen style.

    Of a style for papers and programs, the words between them go to standard error.
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
    """What commands print on."""
    return Printer()


def note(text: str) -> None:
    """Tell the user something beside the result, in a line on standard error."""
    clear()
    typer.echo(one_line(text), err=True)


class Progress(logging.Handler):
    """The step that femnl works on, in the last line of a terminal.

    The next step, or a result, takes its place. Where there is no terminal, a step is told in a
    line of its own after each QUIET seconds.
    """

    def __init__(self) -> None:
        super().__init__()
        self.begin()

    def begin(self) -> None:
        """Count the time without a word from now on."""
        self._told = time.monotonic()

    def emit(self, record: logging.LogRecord) -> None:
        """Show what the logger femnl.progress tells."""
        step = f"{one_line(record.getMessage())} …"
        if sys.stderr.isatty():
            sys.stderr.write(f"{CLEAR}{step}")
            sys.stderr.flush()
        elif time.monotonic() - self._told > QUIET:
            self._told = time.monotonic()
            note(step)


def clear() -> None:
    """Take the step off the terminal before anything else is printed."""
    if sys.stderr.isatty():
        sys.stderr.write(CLEAR)
        sys.stderr.flush()


def print_json(value: Any) -> None:
    """Print one JSON object with full precision and nothing else; NaN and infinities as null."""
    clear()
    text = json.dumps(json_value(value), ensure_ascii=False)
    if not text.isprintable():  # JSON itself escapes but the first 32 signs
        text = "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in text)
    typer.echo(text)


def table(title: str, columns: list[str], rows: list[list[str]]) -> Group:
    """A plain table under its title: text left, numbers right."""
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
    """6.93·10⁻³ for 0.00693; plain digits where the exponent is small."""
    if value == 0 or not math.isfinite(value) or 1e-3 <= abs(value) < 1e5:
        plain = f"{value:.{digits}g}"
        return f"{float(plain):.0f}" if "e+" in plain else plain
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa}·10{str(int(exponent)).translate(SUPERSCRIPT)}"
