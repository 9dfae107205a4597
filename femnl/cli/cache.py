"""`femnl cache show|clear`: results that are kept on disk, so that they are solved once."""

from __future__ import annotations

import time

from femnl.cli._device import Json
from femnl.cli._output import console, note, print_json, table

DAY = 86400.0


def show(*, as_json: Json = False) -> None:
    """Show what is kept, where, how large it is, and how large results may become."""
    from femnl.io.results.cache_folder import VARIABLE, folder, limit, listed

    found = listed()
    most = limit()
    if as_json:
        sizes = {
            name: {"files": len(files), "bytes": sum(kept.size for kept in files)}
            for name, files in found.items()
        }
        print_json({"folder": str(folder()), "limit": most, "kept": sizes})
        return
    rows = [
        [
            name,
            str(len(files)),
            _mebibytes(sum(kept.size for kept in files)),
            _days(min((kept.used for kept in files), default=None)),
        ]
        for name, files in found.items()
    ]
    columns = ["what", "files", "MiB", "oldest use, days ago"]
    console().print(table(str(folder()), columns, rows))
    console().print(
        f"results may take {most / 2**30:.3g} GiB; {VARIABLE} sets another limit, and what was "
        "used least recently goes first"
    )


def clear() -> None:
    """Remove all that is kept: results, and the checkpoints of diagnoses that were interrupted."""
    from femnl.io.results.cache_folder import folder, listed, remove

    files = [kept for found in listed().values() for kept in found]
    freed = remove(files)
    note(f"{folder()}: removed {len(files)} files, {_mebibytes(freed)} MiB")


def _mebibytes(size: int) -> str:
    return f"{size / 2**20:.1f}"


def _days(used: float | None) -> str:
    return "–" if used is None else f"{max(time.time() - used, 0.0) / DAY:.1f}"


COMMANDS = {"show": show, "clear": clear}


def command() -> None:
    """Show or remove the results that are kept on disk, so that they are solved once."""
