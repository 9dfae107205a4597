"""Files appear whole or not at all."""

import os
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from femnl.core.errors import ParameterError
from femnl.core.scratch import scratch


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a file in a temporary folder beside `path`, then rename it.

    A failure leaves what was there before. The file is readable for whom the umask says.

    Raises: ParameterError where the folder cannot be written.
    """
    with ExitStack() as stack:
        try:
            folder = stack.enter_context(scratch(path.parent))
        except OSError as error:
            raise ParameterError(
                f"{path}: cannot write there ({error.strerror}); name a file in a folder that "
                "exists and is writable"
            ) from error
        part = folder / f"part{path.suffix}"
        try:
            write(part)
            with part.open("rb") as written:
                os.fsync(written.fileno())  # the name must not reach the disk before the content
            part.replace(path)
        except OSError as error:
            raise ParameterError(
                f"{path}: writing failed ({error.strerror or error}); nothing was changed"
            ) from error


def write_text_whole(path: Path, text: str) -> None:
    """Let a file of text appear whole; see `write_whole`.

    Bytes of no encoding, as names of files may hold, are written as escapes.
    """
    write_whole(
        path,
        lambda file: file.write_text(text, encoding="utf-8", errors="backslashreplace", newline=""),
    )


def make_folder(path: Path) -> None:
    """Make a folder for results, and those above it, where they are missing.

    Raises: ParameterError where that is impossible.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ParameterError(
            f"{path}: no folder can be made there ({error.strerror}); choose another with --out"
        ) from error


def need_room(path: Path) -> None:
    """Refuse a place where no file can be made, before hours are spent on its content.

    Raises: ParameterError.
    """
    folder = path.parent
    if not folder.is_dir() or not os.access(folder, os.W_OK | os.X_OK):
        raise ParameterError(
            f"{path}: cannot write there; name a file in a folder that exists and is writable"
        )
    if path.is_dir():
        raise ParameterError(f"{path}: is a folder; name a file in it")
