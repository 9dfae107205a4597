"""Find the command that was asked for, run it, and turn every foreseen failure into one line."""

import logging
import os
import sys
from importlib import import_module
from pkgutil import iter_modules

import typer

import femnl
from femnl.errors import FemnlError

ABOUT = "Finite elements for the mechanics and nonlinearity of stressed membranes."


def run(words: list[str]) -> int:
    """Run one command; its exit status: 0 done, 2 the request cannot be met, 130 interrupted."""
    logging.basicConfig(format="femnl: %(message)s", level=logging.WARNING)
    command = typer.main.get_command(_app(words))
    try:
        status = command.main(words, prog_name="femnl", standalone_mode=False)
        sys.stdout.flush()
        if status == 130:  # typer turns an interrupt into this
            raise KeyboardInterrupt
    except FemnlError as error:
        return _fail(str(error))
    except typer.TyperException as error:
        known = not isinstance(command, typer.core.TyperGroup) or words[0] in command.commands
        return _fail(f"{error.format_message().rstrip('.')}; see femnl {words[0]} --help" if known else error.format_message())
    except MemoryError:
        return _fail("the memory is full; ask for fewer modes, a lower --resolution or fewer points, or close other programs")
    except BrokenPipeError:  # the reader, such as `head`, has gone: what follows has no use
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:  # such as a disk that is full or a folder that was taken away meanwhile
        return _fail(f"{error.filename or 'output'}: {error.strerror or error}; check the path, its permissions and the room on the disk")
    return status if isinstance(status, int) else 0


def _fail(line: str, status: int = 2) -> int:
    typer.echo(f"femnl: {' '.join(line.split())}", err=True)
    return status


def _app(words: list[str]) -> typer.Typer:
    """The command that was named, or all of them for the list of what there is; each is the function `command` of its file."""
    app = typer.Typer(help=ABOUT, rich_markup_mode=None, context_settings={"help_option_names": ["-h", "--help"]})
    app.callback()(_root)
    names = {
        module.name.strip("_"): module.name for module in iter_modules(sys.modules[__package__].__path__) if not module.name.startswith("_")
    }
    asked = next((word for word in words if not word.startswith("-")), None)
    for name in [asked] if asked in names else sorted(names):
        app.command(name)(import_module(f"{__package__}.{names[str(name)]}").command)
    return app


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"femnl {femnl.__version__}")
        raise typer.Exit


def _root(version: bool = typer.Option(False, "--version", callback=_version, is_eager=True, help="Show the version.")) -> None:
    """Finite elements for the mechanics and nonlinearity of stressed membranes."""
