"""Tables in the form that a paper, a spreadsheet or a program wants."""

from __future__ import annotations

import csv
import io
import re
import unicodedata
from collections.abc import Sequence
from contextvars import ContextVar
from typing import TYPE_CHECKING, Literal, get_args

if TYPE_CHECKING:
    from rich.table import Table

Style = Literal["text", "markdown", "latex", "csv", "json"]
STYLES: tuple[Style, ...] = get_args(Style)
chosen: ContextVar[Style] = ContextVar("chosen", default="text")

_LATEX = {
    "\\": r"\textbackslash{}",
    "−": "$-$",
    "–": "--",
    "·": r"$\cdot$",
    "×": r"$\times$",
    "±": r"$\pm$",
    "°": r"$^\circ$",
    "…": r"\ldots{}",
}
_LATEX |= {
    "µ": r"\textmu{}",
    "√": r"$\surd$",
    "′": "$'$",
    "ℓ": r"$\ell$",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "|": r"$|$",
}
_LATEX |= {sign: rf"\{sign}" for sign in "&%$#_{}"}


def render(title: str, table: Table) -> str:
    """Write a table and its title in the chosen style, `markdown`, `latex` or `csv`."""
    head = [str(column.header) for column in table.columns]
    right = [column.justify == "right" for column in table.columns]
    rows = [
        list(map(str, row)) for row in zip(*(column.cells for column in table.columns), strict=True)
    ]
    return {"markdown": _markdown, "latex": _latex, "csv": _csv}[chosen.get()](
        title, head, right, rows
    )


def _markdown(
    title: str, head: Sequence[str], right: Sequence[bool], rows: Sequence[Sequence[str]]
) -> str:
    lines = [
        head,
        ["---:" if r else "---" for r in right],
        *([cell.replace("|", r"\|") for cell in row] for row in rows),
    ]
    return "\n".join([f"**{title}**", "", *(f"| {' | '.join(cells)} |" for cells in lines), ""])


def _csv(
    title: str, head: Sequence[str], right: Sequence[bool], rows: Sequence[Sequence[str]]
) -> str:
    stream = io.StringIO()
    stream.write(f"# {title}\n")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(
        [_machine(cell) if r else cell for cell, r in zip(row, right, strict=True)] for row in rows
    )
    return stream.getvalue()


def _machine(cell: str) -> str:
    """Return a number as programs read it: 7.6e12 for 7.6·10¹², and nothing for a dash."""
    cell = re.sub(
        "·10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", lambda power: "e" + unicodedata.normalize("NFKC", power[1]), cell
    ).replace("−", "-")
    return "" if cell in ("–", "-") else cell


def _latex(
    title: str, head: Sequence[str], right: Sequence[bool], rows: Sequence[Sequence[str]]
) -> str:
    columns = "".join("r" if r else "l" for r in right)
    lines = [f"  {' & '.join(map(latex, row))} \\\\" for row in rows]
    top = [
        f"% {latex(title)}; \\usepackage{{booktabs}}",
        rf"\begin{{tabular}}{{{columns}}}",
        r"  \toprule",
    ]
    return "\n".join(
        [
            *top,
            f"  {' & '.join(map(latex, head))} \\\\",
            r"  \midrule",
            *lines,
            r"  \bottomrule",
            r"\end{tabular}",
        ]
    )


def latex(text: str) -> str:
    """Return the text as LaTeX writes it.

    Greek, superscripts and subscripts as mathematics, signs with a meaning escaped.
    """
    return "".join(map(_letter, text)).replace("}$$^{", "").replace("}$$_{", "")


def _letter(sign: str) -> str:
    if sign in _LATEX:
        return _LATEX[sign]
    kind, _, plain = unicodedata.decomposition(sign).partition(" ")
    if kind in ("<super>", "<sub>"):
        return f"${'^' if kind == '<super>' else '_'}{{{chr(int(plain, 16)).replace('−', '-')}}}$"
    words = unicodedata.name(sign, "").split()
    if words[:1] == ["GREEK"] and len(words) == 4 and words[2] == "LETTER":
        name = words[3].lower()
        return rf"$\{name.capitalize() if words[1] == 'CAPITAL' else name}$"
    return sign
