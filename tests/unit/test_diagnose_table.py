"""Tables of diagnoses: a row a file whatever becomes of the others, and none made twice."""

import json
import logging
import signal
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import psutil
import pytest

from femnl.cli._main import run
from femnl.core.effect import Effect, Values
from femnl.core.errors import GeometryError, ParameterError
from femnl.core.resources import geometries
from femnl.core.stages import Points
from femnl.diagnose import diagnose, table
from femnl.diagnose.one_file import Task, attempt, loaded, settings_of, task_of
from femnl.diagnose.table import COLUMNS, diagnose_many
from femnl.effects import library
from femnl.io import measurement
from femnl.io.labfiles import import_file
from tests.unit.test_sweep_runs import Starter, cluster_of, patience, start

__all__ = ["start"]  # a fixture
PRESSURE = np.array([0.1, 1, 3, 10, 30, 60, 100, 150, 200, 300.0])
ORDERS = np.array([(1, 1), (1, 2), (2, 1), (2, 2), (1, 3), (3, 1)])
DAMPED = 1 / (1 / 2e5 + 3e-8 * PRESSURE)
SPEC = """kind = "series"
geometry = "{}"
[columns]
pressure = {{ column = "p", unit = "Pa" }}
quality_factor = "Q"
quality_factor_sd = "sd"
"""


@pytest.fixture(autouse=True)
def _own_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "temporary").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))


@pytest.fixture
def done(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Diagnose in this process, the last file first, and list the files.

    The order in which real processes end cannot be chosen; other tests below start them.
    """
    names = list[str]()

    def here(
        tasks: Iterator[Task], begin: Any, workers: int, died: object
    ) -> Iterator[tuple[Task, Any]]:
        for task in reversed(list(tasks)):
            names.append(str(task.path))
            yield task, attempt(task, begin.args[1])

    monkeypatch.setattr(table, "share_out", here)
    return names


def few() -> list[Effect]:
    """The causes that a table considers here."""
    return [library()[name] for name in ("trapped_gas", "photothermal")]


def noisy(quality: np.ndarray, seed: int) -> np.ndarray:
    return quality * (1 + 0.01 * np.random.default_rng(seed).standard_normal(quality.size))


def quality_file(name: str, seed: int = 4, geometry: str = "square-270um") -> Path:
    """A measurement file of quality factors that a gas lowers."""
    quality = noisy(DAMPED, seed)
    data = measurement.series(
        {"pressure": PRESSURE}, quality_factor=quality, quality_factor_sd=0.01 * DAMPED
    )
    path = Path(name)
    measurement.write(measurement.bundle({"q": data}, geometry=geometry), path)
    return path


def lab_file(name: str, geometry: str = "square-270um") -> Path:
    """The same as a table of a laboratory, and what its columns are."""
    path = Path(name)
    path.parent.mkdir(exist_ok=True)
    columns = np.column_stack([PRESSURE, noisy(DAMPED, 4), 0.01 * DAMPED])
    np.savetxt(path, columns, delimiter=",", header="p,Q,sd", comments="")
    path.with_suffix(".toml").write_text(SPEC.format(geometry), encoding="utf-8")
    return path


def test_a_row_a_file_in_the_order_given_whatever_some_of_them_hold(done: list[str]) -> None:
    good = quality_file("good.nc")
    again = quality_file("again.nc")
    Path("bad.nc").write_text("no measurement", encoding="utf-8")
    Path("worse.nc").write_text("no measurement", encoding="utf-8")
    Path("picture.png").write_bytes(b"\x89PNG")
    lab = lab_file("lab.csv")
    names: list[str | Path]
    names = [good, "bad.nc", lab, again, "none.nc", "worse.nc", "picture.png", good]
    told = list[tuple[int, int]]()
    rows = diagnose_many(
        names, effects=few(), out="out.csv", tell=lambda *counts: told.append(counts)
    )
    assert tuple(rows.columns) == COLUMNS
    assert list(rows["file"]) == [str(name) for name in names]
    assert list(rows["message"].str.len() > 0) == [
        False,
        True,
        False,
        False,
        True,
        True,
        True,
        False,
    ]
    messages = dict(zip(rows["file"], rows["message"], strict=True))
    assert messages["bad.nc"].startswith("bad.nc: is a text file, and no measurement file")
    assert messages["worse.nc"].startswith("worse.nc: is a text file, and no measurement file")
    assert messages["none.nc"] == "none.nc: no such file; check the path"
    assert messages["picture.png"].startswith("picture.png: format not recognised; known are")
    assert sorted(done) == ["bad.nc", "good.nc", "lab.csv", "none.nc", "picture.png"]
    assert told[0] == (0, 0)
    assert told[-1] == (8, 4)
    # The same measurement, whichever way it comes, gives what `diagnose` says of it
    found = diagnose(good, effects=few())
    assert found.causes == ("trapped_gas",)
    for place in (0, 2, 3, 7):
        row = rows.iloc[place]
        assert (row["verdict"], row["causes"]) == ("explained", "trapped_gas")
        assert row["p_value"] == pytest.approx(found.p_value, rel=1e-9)
        assert row["gain"] == pytest.approx(found.gain, rel=1e-9)
        assert row["parameters"] == rows["parameters"][0]
    owners = [text.split(".")[0] for text in rows["parameters"][0].split("; ")]
    assert owners == ["trapped_gas"] * len(found.parameters["trapped_gas"]) + ["base"] * len(
        found.parameters["base"]
    )
    assert " ± " in rows["parameters"][0]
    written = pd.read_csv("out.csv", keep_default_na=False, na_values={"p_value": "", "gain": ""})
    pd.testing.assert_frame_equal(written, rows, check_dtype=False)


def test_what_is_finished_is_made_again_only_where_something_changed(done: list[str]) -> None:
    first, second = quality_file("first.nc", 1), quality_file("second.nc", 2)
    Path("bad.nc").write_text("no measurement", encoding="utf-8")

    def made(files: list[Any], **options: Any) -> list[str]:
        done.clear()
        rows = diagnose_many(files, out="out.csv", **{"effects": few(), **options})
        assert list(rows["file"]) == [str(file) for file in files]
        return list(done)

    assert made([first]) == ["first.nc"]
    assert made([second, "bad.nc", first]) == ["bad.nc", "second.nc"]
    assert made([first, second]) == []
    assert made(["bad.nc", second]) == ["bad.nc"], "what failed is tried again"
    second.rename("third.nc")
    assert made(["third.nc"]) == [], "a file is known by its content"
    assert made([first], geometry="circle") == ["first.nc"]
    assert made([first], effects=few()[:1]) == ["first.nc"]
    quality_file("first.nc", 3)
    assert made(["third.nc", first]) == ["first.nc"]
    lab = lab_file("lab/run.csv", "device.toml")
    shipped = (geometries() / "square-270um.toml").read_text(encoding="utf-8")
    device = Path("lab/device.toml")
    device.write_text(shipped, encoding="utf-8")
    assert made([lab]) == ["lab/run.csv"]
    assert made([lab]) == []
    device.write_text(f"{shipped}\n# another stress\n", encoding="utf-8")
    assert made([lab]) == ["lab/run.csv"], "the geometry beside a lab file counts"
    lab.with_suffix(".toml").write_text(f"{SPEC.format('device.toml')}# other columns\n")
    assert made([lab]) == ["lab/run.csv"], "so does what its columns are"


@pytest.mark.parametrize(
    "damage",
    [
        lambda line: line[:-1],
        lambda line: line[: len(line) // 2],
        lambda line: line.replace(b'"gain": ', b'"gain": 1'),
        lambda line: line.replace(b'"femnl_row": "', b'"femnl_row": "0'),
        lambda line: b"\xff\xfe\n",
    ],
    ids=["no end", "torn", "another gain", "another key", "no text"],
)
def test_a_damaged_line_is_told_and_its_file_is_diagnosed_again(
    damage: Callable[[bytes], bytes], done: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    files = [quality_file(f"{k}.nc", k) for k in range(3)]
    rows = diagnose_many(files, effects=few(), out="out.csv")
    kept = Path("out.jsonl")
    lines = kept.read_bytes().splitlines(keepends=True)
    kept.write_bytes(lines[0] + lines[2] + damage(lines[1]))
    done.clear()
    with caplog.at_level(logging.WARNING, "femnl"):
        again = diagnose_many(files, effects=few(), out="out.csv")
    assert done == ["1.nc"]
    told = [record for record in caplog.records if record.levelno >= logging.WARNING]
    assert [record.getMessage() for record in told] == [
        "out.jsonl: line 3 is damaged and set aside in out.jsonl.damaged; "
        "its file is diagnosed anew"
    ]
    pd.testing.assert_frame_equal(again.drop(columns="seconds"), rows.drop(columns="seconds"))
    caplog.clear()
    done.clear()
    diagnose_many(files, effects=few(), out="out.csv")
    assert (done, caplog.records) == ([], [])


def test_lab_files_take_the_geometry_beside_them_and_messages_name_no_temporary_file(
    tmp_path: Path,
) -> None:
    shipped = (geometries() / "square-270um.toml").read_text(encoding="utf-8")
    lab = lab_file("lab/run.csv", "device.toml")
    settings = settings_of(None, few())

    def both(told: str = "") -> dict[str, Any]:
        """Return the row from the files in their places, as from their contents elsewhere."""
        task = task_of(lab, settings)
        row = attempt(task, settings, str(tmp_path))
        sent = attempt(loaded(task), settings)
        for message in (row.pop("message"), sent.pop("message")):
            assert told in message
            assert bool(told) == bool(message)
            assert "femnl-" not in message
        del row["seconds"], sent["seconds"]
        assert list(map(str, sent.values())) == list(map(str, row.values()))
        return row

    both("lab/device.toml: cannot be read: No such file or directory")
    (tmp_path / "lab" / "device.toml").write_text(shipped, encoding="utf-8")
    row = both()
    assert row["causes"] == "trapped_gas"
    import_file(lab, "lab/imported.nc")
    found = diagnose("lab/imported.nc", effects=few())
    assert (row["p_value"], row["gain"]) == (found.p_value, found.gain)
    lab_file("lab/run.csv", "../device.toml")
    (tmp_path / "device.toml").write_text(shipped, encoding="utf-8")
    both("lab/run.csv: geometry '../device.toml' leaves the file's folder")


def test_a_geometry_that_is_given_counts_for_every_file_and_goes_with_them(tmp_path: Path) -> None:
    shipped = (geometries() / "square-270um.toml").read_text(encoding="utf-8")
    (tmp_path / "ours.toml").write_text(shipped, encoding="utf-8")
    path = quality_file("file.nc", geometry="nowhere")
    assert attempt(task_of(path, settings_of(None, few())), settings_of(None, few()))["message"]
    for geometry in ("ours.toml", "square-270um"):
        settings = settings_of(geometry, few())
        row = attempt(loaded(task_of(path, settings)), settings)
        assert (row["causes"], row["message"]) == ("trapped_gas", "")
    with pytest.raises(GeometryError, match=r"missing\.toml"):
        settings_of("missing.toml", few())


def fail(points: Points, values: Values) -> Points:
    raise RuntimeError("no way on")


def fill_memory(points: Points, values: Values) -> Points:
    raise MemoryError


def fill_disk(points: Points, values: Values) -> Points:
    raise OSError(28, "No space left on device", "/tmp/x")


@pytest.mark.parametrize(
    ("fault", "told", "logged"),
    [
        (fail, "a fault of femnl (RuntimeError: no way on)", 1),
        (fill_memory, "the memory is full; lower --workers", 0),
        (fill_disk, "/tmp/x: No space left on device", 0),
    ],
)
def test_a_fault_of_femnl_and_a_full_memory_cost_their_own_row_alone(
    fault: Callable[[Points, Values], Points],
    told: str,
    logged: int,
    caplog: pytest.LogCaptureFixture,
) -> None:
    broken = replace(library()["trapped_gas"], name="broken", changes={"points": fault})
    settings = settings_of(None, [broken])
    assert told in attempt(task_of(quality_file("file.nc"), settings), settings)["message"]
    faults = [record for record in caplog.records if record.exc_info is not None]
    assert len(faults) == logged


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--table", "out.csv"], "Missing argument 'FILE'"),
        (["a.nc", "b.nc"], "2 files given; add --table OUT.csv for a row of each, or name one"),
        (["a.nc", "folder", "--table", "out.csv"], "the files in it, such as folder/*.nc"),
        (["a.nc", "records", "--table", "out.csv"], "the files in it, such as records/*.txt"),
        (["a.nc", "--table", "none/out.csv"], "none/out.csv: cannot write there"),
        (["a.nc", "--table", "out.txt"], "--table out.txt: expected a name that ends in .csv"),
        (["a.nc", "--table", "a.csv"], "a.csv: exists and is no table of diagnoses"),
        (["a.csv", "--table", "a.csv"], "a.csv: is both a file to diagnose and the table"),
        (["a.nc", "--table", "sweep.csv"], "sweep.jsonl: is no checkpoint of a table of diagnoses"),
        (["a.nc", "--table", "out.csv", "--geometry", "sqare"], "sqare: neither a shipped"),
        (["a.nc", "--table", "out.csv", "--out", "page"], "leave --out out"),
        (["a.nc", "--scheduler", "local"], "--scheduler local: shares out files"),
        (
            ["a.nc", "--table", "out.csv", "--scheduler", "tcp://a:1", "--workers", "2"],
            "--workers 2: the scheduler at tcp://a:1 has workers of its own",
        ),
        (["a.nc"], "a.nc: no such file; check the path"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_request_that_cannot_be_met_is_one_line_and_changes_nothing(
    words: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "records").mkdir()
    for name in ("1.txt", "2.txt", "notes.csv"):
        (tmp_path / "records" / name).touch()
    (tmp_path / "a.csv").write_text("p,Q\n1,2\n", encoding="utf-8")
    (tmp_path / "sweep.jsonl").write_text('{"femnl_sweep": 1}\n', encoding="utf-8")
    before = sorted(tmp_path.iterdir())
    assert run(["diagnose", *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line
    assert sorted(tmp_path.iterdir()) == before
    assert (tmp_path / "a.csv").read_text(encoding="utf-8") == "p,Q\n1,2\n"


def test_nothing_is_done_for_no_file_or_beside_another_command(done: list[str]) -> None:
    with pytest.raises(ParameterError, match="no file given; name at least one"):
        diagnose_many([], out="out.csv")
    with pytest.raises(ParameterError, match="workers: 0 is none"):
        diagnose_many(["a.nc"], workers=0)
    path = quality_file("a.nc")

    def second(*_: object) -> None:
        with pytest.raises(ParameterError, match="another femnl diagnose is writing to this table"):
            diagnose_many([path], effects=few(), out="out.csv")

    diagnose_many([path], effects=few(), out="out.csv", tell=second)
    assert done == ["a.nc"]


def rows_of(path: Path) -> list[dict[str, Any]]:
    """The whole lines of a checkpoint."""
    lines = path.read_bytes().splitlines(keepends=True) if path.exists() else []
    return [json.loads(line) for line in lines if line.endswith(b"\n")]


def program(folder: Path, name: str, body: str) -> str:
    """Write a program whose diagnoses of some files do something else; its name."""
    (folder / name).write_text(
        "import os, signal, sys, time\n"
        "from functools import partial\n"
        "from femnl.core.processes import answer\n"
        "from femnl.diagnose import table\n"
        "from femnl.diagnose.one_file import attempt\n"
        "def find(task, settings, folder):\n"
        f"    {body}\n"
        "    return attempt(task, settings, folder)\n"
        "def serve(connection, settings, folder):\n"
        "    answer(connection, partial(find, settings=settings, folder=folder))\n"
        "if __name__ == '__main__':\n"
        "    table._serve = serve\n"
        "    from femnl.cli import main\n"
        "    main()\n",
        encoding="utf-8",
    )
    return name


@pytest.mark.slow
def test_a_file_that_kills_every_process_fails_alone(tmp_path: Path, start: Starter) -> None:
    # Stands for a file that takes more memory than there is: the system kills the process,
    # without a word to Python.
    deadly = program(
        tmp_path,
        "deadly.py",
        "if task.path.name == '1.nc': os.kill(os.getpid(), signal.SIGKILL)",
    )
    files = [str(quality_file(f"{k}.nc", k)) for k in range(3)]
    words = ("diagnose", *files, "--table", "out.csv", "--workers", "1")
    client = start(deadly, *words, folder=tmp_path)
    _, errors = client.communicate(timeout=300)
    assert client.returncode == 0, errors
    assert errors.count("a worker died (exit code -9) at 1.nc") == 3
    assert "wrote out.csv: 2 files diagnosed, 1 failed" in errors
    rows = pd.read_csv("out.csv", keep_default_na=False)
    assert list(rows["file"]) == files
    assert list(rows["causes"]) == ["trapped_gas", "", "trapped_gas"]
    assert rows["message"][1].startswith("1.nc: its process died 3 times (exit code -9;")
    assert len(rows_of(tmp_path / "out.jsonl")) == 2


def test_files_that_fail_for_one_reason_are_counted_together(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name in ("bad.nc", "worse.nc"):
        Path(name).write_text("no measurement", encoding="utf-8")
    assert run(["diagnose", "bad.nc", "worse.nc", "none.nc", "--table", "out.csv"]) == 0
    counted = [line for line in capsys.readouterr().out.splitlines() if line.startswith("failed")]
    assert [line.split()[-1] for line in counted] == ["2", "1"]
    assert "bad.nc" not in "".join(counted)


def test_an_interrupt_is_one_line_leaves_all_that_is_finished_and_is_gone_on_from(
    tmp_path: Path, start: Starter
) -> None:
    slow = program(tmp_path, "slow.py", "if task.path.name == '2.nc': time.sleep(600)")
    files = [str(quality_file(f"{k}.nc", k)) for k in range(4)]
    words = ("diagnose", *files, "--table", "out.csv", "--workers", "1")
    client = start(slow, *words, folder=tmp_path)
    with patience() as pause:
        while len(rows_of(tmp_path / "out.jsonl")) < 2:
            pause()
    children = psutil.Process(client.pid).children(recursive=True)
    assert children
    client.send_signal(signal.SIGINT)
    _, errors = client.communicate(timeout=90)
    assert client.returncode == 130
    # After two seconds a command says what it works on
    said = [line for line in errors.splitlines() if not line.startswith("working on ")]
    assert said == ["femnl: interrupted; nothing was left half-written"]
    psutil.wait_procs(children, timeout=30)
    assert not [child for child in children if child.is_running()]
    assert list(pd.read_csv("out.csv")["file"]) == files[:2]
    assert not list((tmp_path / "temporary").glob("femnl-*"))
    kept = (tmp_path / "out.jsonl").read_bytes()
    again = start("-m", "femnl", *words, "--workers", "1", folder=tmp_path)
    _, errors = again.communicate(timeout=300)
    assert again.returncode == 0, errors
    assert (tmp_path / "out.jsonl").read_bytes().startswith(kept)
    assert len(rows_of(tmp_path / "out.jsonl")) == 4
    assert list(pd.read_csv("out.csv")["file"]) == files


@pytest.mark.slow
def test_workers_of_a_cluster_need_no_common_disk(tmp_path: Path, start: Starter) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    address, _ = cluster_of(1, elsewhere, start)
    shipped = (geometries() / "square-270um.toml").read_text(encoding="utf-8")
    (tmp_path / "ours.toml").write_text(shipped, encoding="utf-8")
    Path("bad.nc").write_text("no measurement", encoding="utf-8")
    files = [str(quality_file("a.nc", geometry="nowhere")), "bad.nc", str(lab_file("lab/run.csv"))]
    words = ("diagnose", *files, "--table", "out.csv", "--geometry", "ours.toml")
    client = start("-m", "femnl", *words, "--scheduler", address, folder=tmp_path)
    _, errors = client.communicate(timeout=300)
    assert client.returncode == 0, errors
    rows = pd.read_csv("out.csv", keep_default_na=False)
    assert list(rows["file"]) == files
    assert list(rows["causes"]) == ["trapped_gas", "", "trapped_gas"]
    assert rows["message"][1].startswith("bad.nc: is a text file, and no measurement file")
    assert len(rows_of(tmp_path / "out.jsonl")) == 2
