"""Pages of the site that are made from the code: one for each command, one for each cause.

`write()` writes them before the site is built, so that they cannot differ from what femnl does.
"""

import re
import textwrap
from collections.abc import Iterable
from pathlib import Path

import typer

from femnl.cli._main import CHAPTERS, _app
from femnl.cli.effects import imitated
from femnl.core.effect import Effect, ParameterSpec
from femnl.core.numbers import plain, scale_for
from femnl.effects import library

DOCS = Path(__file__).parent
EXAMPLE = re.compile(r"^    # .+\n(?:    femnl .+\n)+", re.MULTILINE)
OPTION = re.compile(r"(?<![\w`-])--[a-z][\w-]*")


def write() -> None:
    """Write `commands/` and `effects/` beside this file."""
    commands = {f"commands/{name}.rst": command_page(name) for name in command_names()}
    effects = {f"effects/{e.name}.rst": effect_page(e) for e in library().values()}
    pages = commands | effects
    pages["commands/index.rst"] = commands_page()
    pages["effects/index.rst"] = effects_page()
    for name, text in pages.items():
        path = DOCS / name
        path.parent.mkdir(exist_ok=True)
        # A page that has not changed keeps its time, and is not built again
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def command_names() -> list[str]:
    """Return the commands in the order of work."""
    return [name for names in CHAPTERS.values() for name in names]


def command_page(name: str) -> str:
    """Return the page of a command: what it does, its arguments and options, examples."""
    group = typer.main.get_command(_app([name]))
    assert isinstance(group, typer.core.TyperGroup)
    command = group.commands[name]
    parent = group.make_context("femnl", [name], resilient_parsing=True)
    context = command.make_context(name, [], parent, resilient_parsing=True)
    usage = " ".join(["femnl", name, *command.collect_usage_pieces(context)])
    records = [parameter.get_help_record(context) for parameter in command.get_params(context)]
    rows = [(f"``{names}``", _escaped(_as_code(text))) for names, text in filter(None, records)]
    parts = [
        _title(f"femnl {name}"),
        _escaped(_as_code(command.help or "")),
        _literal([usage]),
        _table(("argument or option", "what it does"), rows, (35, 65)),
    ]
    examples = examples_of(name)
    if examples:
        parts += [_title("Examples", "-"), _literal("\n\n".join(examples).split("\n"))]
    return _joined(parts)


def examples_of(name: str) -> list[str]:
    """Return the uses of a command that the page of all commands shows, with what they do."""
    text = (DOCS / "reference" / "commands.md").read_text(encoding="utf-8")
    found = [textwrap.dedent(block).strip() for block in EXAMPLE.findall(text)]
    return [block for block in found if block.split("\n")[1].split()[1] == name]


def commands_page() -> str:
    """Return the list of commands, by chapters."""
    parts = [_title("Each command"), "``femnl COMMAND --help`` prints the same."]
    for chapter, names in CHAPTERS.items():
        parts += [_contents(names, chapter)]
    return _joined(parts)


def effect_page(effect: Effect) -> str:
    """Return the page of a cause: equation, parameters with their ranges, source, limits."""
    rows = [_parameter_row(parameter) for parameter in effect.parameters]
    head = ("parameter", "range", "why no more")
    told = {
        "Shows in": ", ".join(effect.kinds),
        "Source": effect.source,
        "Limits": effect.limits,
        "Accuracy": f"{effect.accuracy:.1%} of what it does; {effect.accuracy_reason}",
    }
    if effect.imitates:
        told["Takes up in another's place, at most"] = imitated(effect)
    return _joined(
        [
            _title(effect.name),
            f"{_escaped(effect.sentence[0].upper() + effect.sentence[1:])}.",
            _literal([effect.equation]),
            _table(head, rows, (20, 30, 50)),
            *(f"**{name}.** {_escaped(text)}" for name, text in told.items()),
        ]
    )


def effects_page() -> str:
    """Return the list of causes."""
    words = "The physical causes that a diagnosis knows. ``femnl effects`` lists them, too."
    return _joined([_title("Causes"), words, _contents(sorted(library()), "")])


def _parameter_row(parameter: ParameterSpec) -> tuple[str, str, str]:
    """Return name, range in a readable unit, and the reason of a parameter."""
    if parameter.scale:
        unit = "" if parameter.unit == "1" else f" ({parameter.unit})"
        low = parameter.low
        high = parameter.high
        after = f" × {parameter.scale}{unit}"
    else:
        scale = scale_for(max(abs(parameter.low), abs(parameter.high)), parameter.unit)
        low = parameter.low / scale.size
        high = parameter.high / scale.size
        after = f" {scale.unit}".rstrip()
    size = f"{plain(low, 3)} … {plain(high, 3)}{after}"
    return f"``{parameter.name}``", _escaped(size), _escaped(parameter.reason)


def _title(words: str, line: str = "=") -> str:
    return f"{words}\n{line * len(words)}"


def _contents(names: Iterable[str], caption: str) -> str:
    head = [".. toctree::", "   :maxdepth: 1", *([f"   :caption: {caption}"] if caption else [])]
    return "\n".join([*head, "", *(f"   {name}" for name in names)])


def _literal(lines: Iterable[str]) -> str:
    return "\n".join([".. code-block:: text", "", *(f"   {line}" for line in lines)])


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]], widths: tuple[int, ...]) -> str:
    """Return a table, nothing where there are no rows."""
    listed = list(rows)
    if not listed:
        return ""
    lines = [".. list-table::", "   :header-rows: 1"]
    lines += [f"   :widths: {' '.join(map(str, widths))}", ""]
    for row in (head, *listed):
        for k, cell in enumerate(row):
            lines.append(f"   {'* -' if k == 0 else '  -'} {' '.join(cell.split())}")
    return "\n".join(lines)


def _as_code(text: str) -> str:
    """Put options in a text of help between backquotes."""
    return OPTION.sub(r"`\g<0>`", text)


def _escaped(text: str) -> str:
    """Return text in which reStructuredText sees no mark-up but `code`."""
    parts = text.split("`")
    if len(parts) % 2 == 0:  # a single backquote is no code
        return re.sub(r"([\\*`|_])", r"\\\1", text)
    parts[::2] = [re.sub(r"([\\*|_])", r"\\\1", part) for part in parts[::2]]
    parts[1::2] = [f"``{part}``" for part in parts[1::2]]
    return "".join(parts)


def _joined(parts: Iterable[str]) -> str:
    return "\n\n".join(part for part in parts if part) + "\n"
