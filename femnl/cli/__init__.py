"""The command line: one file a command, found by its name; parsing and printing only."""

from femnl.cli._main import main

__all__ = ["main"]
