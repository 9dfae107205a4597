"""The cache has a limit, beyond which goes what was used least recently; commands show it."""

import json
import logging
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from femnl.cli._main import run
from femnl.core.errors import ParameterError
from femnl.io.results import cache_folder
from femnl.io.results.cache import kept

MEBI = 2**20
Keep = Callable[[int], None]


@pytest.fixture(autouse=True)
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A cache of its own, limited to 3.5 MiB."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("FEMNL_CACHE_GIB", str(3.5 / 1024))
    monkeypatch.delenv("COLUMNS", raising=False)
    path = cache_folder.folder()
    assert path.is_relative_to(tmp_path)
    return path


@pytest.fixture
def keep(folder: Path) -> Keep:
    """Keep a result of 1 MiB, or read it where it is there; time passes from one to the next."""
    now = 1e9

    def write(file: Path, _: None) -> None:
        file.write_bytes(bytes(MEBI))

    def one(number: int) -> None:
        nonlocal now
        path = folder / f"modes-{number}.nc"
        kept(path, lambda: None, lambda: None, write)
        now += 1
        os.utime(path, (now, now))

    return one


def names(folder: Path) -> list[str]:
    """Return the files of the cache."""
    return sorted(path.name for path in folder.iterdir())


def test_what_was_used_least_recently_goes_first_and_is_told(
    folder: Path, keep: Keep, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING, "femnl")
    for number in (1, 2, 3):
        keep(number)
    keep(1)
    assert not caplog.messages
    keep(4)
    assert names(folder) == ["modes-1.nc", "modes-3.nc", "modes-4.nc"]
    (told,) = caplog.messages
    assert told.startswith("the cache held more than 0.00342 GiB: removed 1 result used least")


def test_reading_a_result_counts_as_its_use(folder: Path, keep: Keep) -> None:
    keep(1)
    before = (folder / "modes-1.nc").stat().st_mtime
    kept(folder / "modes-1.nc", lambda: None, lambda: None, lambda *_: None)
    assert (folder / "modes-1.nc").stat().st_mtime > before + 1e6


def test_what_was_just_kept_and_the_checkpoints_stay(
    folder: Path, keep: Keep, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder.mkdir(parents=True)
    (folder / "diagnosis-a.jsonl").write_bytes(bytes(9 * MEBI))
    monkeypatch.setenv("FEMNL_CACHE_GIB", "0")
    keep(1)
    keep(2)
    assert names(folder) == ["diagnosis-a.jsonl", "modes-2.nc"]


def test_files_that_another_process_removes_meanwhile_are_no_failure(
    folder: Path, keep: Keep
) -> None:
    keep(1)
    files = cache_folder.listed()["modes"]
    (folder / "modes-1.nc").unlink()
    assert cache_folder.remove(files) == 0


@pytest.mark.parametrize("text", ["four", "-1", "nan"])
def test_a_limit_that_is_no_size_is_refused(
    text: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FEMNL_CACHE_GIB", text)
    with pytest.raises(ParameterError, match=f"FEMNL_CACHE_GIB={text}: expected a size in GiB"):
        cache_folder.limit()
    assert run(["cache", "show"]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_the_commands_show_and_clear_it(
    folder: Path, keep: Keep, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["cache", "show", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["kept"]["modes"] == {"files": 0, "bytes": 0}
    keep(1)
    keep(2)
    (folder / "diagnosis-a.jsonl").write_bytes(b"{}")
    (folder / "notes.txt").write_bytes(b"of the user")
    assert run(["cache", "show", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["folder"] == str(folder)
    assert told["kept"]["modes"] == {"files": 2, "bytes": 2 * (MEBI + 32)}
    assert run(["cache", "show"]) == 0
    out = capsys.readouterr().out
    assert "results may take 0.00342 GiB; FEMNL_CACHE_GIB sets another limit" in out
    assert run(["cache", "clear"]) == 0
    assert capsys.readouterr().err == f"{folder}: removed 3 files, 2.0 MiB\n"
    assert names(folder) == ["notes.txt"]


def test_the_files_are_readable_for_whom_the_umask_says(folder: Path, keep: Keep) -> None:
    before = os.umask(0o077)
    try:
        keep(1)
    finally:
        os.umask(before)
    for path in (folder, folder / "modes-1.nc"):
        assert path.stat().st_mode & 0o077 == 0
