"""Find the command that was asked for, run it, and turn every foreseen failure into one line."""

import ast
import logging
import os
import shlex
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import wraps
from importlib import import_module
from inspect import Parameter, Signature, signature
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType
from typing import Annotated, Any

import typer

import femnl
from femnl.cli._format import STYLES, chosen
from femnl.cli._output import PROGRESS, note
from femnl.core.errors import FemnlError, ParameterError, warn_in_lines

CHAPTERS = {
    "A device": ("geometries", "geometry", "mesh", "modes", "bands", "view"),
    "What a readout shows of it": ("maps", "sweep"),
    "Measurements": ("import", "show", "fit", "diagnose", "chip", "effects"),
    "Trust": ("validate", "report"),
    "Housekeeping": ("cache",),
}
Format = Annotated[str, typer.Option("--format", help=f"How to print tables: {', '.join(STYLES)}.")]
ABOUT = "Finite elements for the mechanics and nonlinearity of stressed membranes."


def run(words: list[str]) -> int:
    """Run one command; its exit status: 0 done, 2 the request cannot be met, 130 interrupted."""
    chosen.set("text")
    warn_in_lines()
    logging.getLogger("femnl.progress").addHandler(PROGRESS)
    logging.getLogger("femnl.progress").setLevel(logging.INFO)
    command = typer.main.get_command(_app(words))
    try:
        with PROGRESS.watch(shlex.join(["femnl", *words])):
            status = command.main(words, prog_name="femnl", standalone_mode=False)
        sys.stdout.flush()
        if status == 130:  # typer turns an interrupt into this
            raise KeyboardInterrupt
    except FemnlError as error:
        return _fail(str(error))
    except typer.TyperException as error:
        known = not isinstance(command, typer.core.TyperGroup) or words[0] in command.commands
        return _fail(
            f"{error.format_message().rstrip('.')}; see femnl {words[0]} --help"
            if known
            else error.format_message()
        )
    except MemoryError:
        return _fail(
            "the memory is full; ask for fewer modes, a lower --resolution or fewer points, or "
            "close other programs"
        )
    except (BrokenPipeError, SystemExit) as ended:
        # The reader, such as `head`, has gone: what follows has no use. rich and typer exit then.
        if BrokenPipeError not in (type(ended), type(ended.__context__)):
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    # Such as a disk that is full or a folder that was taken away meanwhile
    except OSError as error:
        return _fail(
            f"{error.filename or 'output'}: {error.strerror or error}; check the path, its "
            "permissions and the room on the disk"
        )
    return status if isinstance(status, int) else 0


def _fail(line: str, status: int = 2) -> int:
    with suppress(OSError):  # of a standard error on a full disk the status is left
        note(f"femnl: {' '.join(line.split())}")
    return status


class _Contents(typer.core.TyperGroup):
    """Help that reads like a table of contents."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands by chapters, in the order of work; those in no chapter come last."""
        rest = sorted(
            self.commands.keys() - {name for names in CHAPTERS.values() for name in names}
        )
        for heading, names in {**CHAPTERS, "Other commands": rest}.items():
            rows = [
                (name, self.commands[name].get_short_help_str(96))
                for name in names
                if name in self.commands
            ]
            if rows:
                with formatter.section(heading):
                    formatter.write_dl(rows)


def _with_format(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command that prints one JSON object the option --format too."""
    parameters = signature(command, eval_str=True).parameters
    if "as_json" not in parameters:
        return command

    @wraps(command)
    def run_formatted(style: str, **options: Any) -> None:
        known = next((s for s in STYLES if s == style), None)
        if known is None:
            raise ParameterError(f"--format {style}: expected one of {', '.join(STYLES)}")
        chosen.set(known)
        command(**options | {"as_json": options["as_json"] or known == "json"})

    style = Parameter("style", Parameter.KEYWORD_ONLY, default="text", annotation=Format)
    vars(run_formatted)["__signature__"] = Signature([*parameters.values(), style])
    return run_formatted


def _app(words: list[str]) -> typer.Typer:
    """Return the program with the command that was named, or with all of them for the contents.

    Each is the function `command` of its file.
    """
    app = typer.Typer(
        help=ABOUT,
        cls=_Contents,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_root)
    names = {
        module.name.strip("_"): module.name
        for module in iter_modules(sys.modules[__package__].__path__)
        if not module.name.startswith("_")
    }
    asked = next((word for word in (*words, *_being_completed()) if not word.startswith("-")), "")
    if asked in names:
        found = import_module(f"{__package__}.{names[asked]}")
        if hasattr(found, "COMMANDS"):
            app.add_typer(_group(found), name=asked)
        else:
            app.command(asked)(_with_format(found.command))
    else:
        for name, module in sorted(names.items()):
            app.command(name, help=_summary(module))(_listed)
    return app


def _group(module: ModuleType) -> typer.Typer:
    """Return the commands under one name, such as femnl geometry check."""
    group = typer.Typer(
        help=module.command.__doc__, rich_markup_mode=None, invoke_without_command=True
    )
    group.callback()(_help)
    for name, command in module.COMMANDS.items():
        group.command(name)(_with_format(command))
    return group


def _help(context: typer.Context) -> None:
    """Show what there is, where no command is given."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def _being_completed() -> list[str]:
    """Return the words after `femnl` of a line that the shell asks to complete."""
    line = os.environ.get("_TYPER_COMPLETE_ARGS") or os.environ.get("COMP_WORDS", "")
    return line.split()[1:] if "_FEMNL_COMPLETE" in os.environ else []


def _listed() -> None:
    """Stand for a command in the list of them, which needs none of their modules."""


def _summary(module: str) -> str:
    """Return what a command says of itself, read without running its module."""
    tree = ast.parse((Path(__file__).parent / f"{module}.py").read_text(encoding="utf-8"))
    functions = (node for node in tree.body if isinstance(node, ast.FunctionDef))
    command = next(function for function in functions if function.name == "command")
    return ast.get_docstring(command) or ""


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"femnl {femnl.__version__}")
        raise typer.Exit


def _root(
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Show the version."
    ),
) -> None:
    """Finite elements for the mechanics and nonlinearity of stressed membranes."""
