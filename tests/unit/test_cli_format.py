"""Tables for papers and programs, help by chapters, completion, and progress."""

import csv
import io
import json
import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from femnl.cli._format import latex
from femnl.cli._main import run

DRUM = ["modes", "circle", "--count", "2", "--resolution", "0.5", "--no-cache", "--format"]
ROOT = Path(__file__).parents[2]


def test_markdown_is_a_table_of_as_many_columns_as_its_head(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run([*DRUM, "markdown"]) == 0
    title, blank, head, rule, *rows, end = capsys.readouterr().out.splitlines()
    assert title.startswith("**circle, ")
    assert blank == end == ""
    assert head.startswith("| mode | label | f (MHz) |")
    assert rule.startswith("| ---: | ")
    assert len(rows) == 2
    assert {line.count("|") for line in (head, rule, *rows)} == {head.count("|")}


def test_csv_holds_numbers_that_programs_read(capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*DRUM, "csv"]) == 0
    comment, *lines = capsys.readouterr().out.splitlines()
    assert comment.startswith("# circle")
    first, second = csv.DictReader(io.StringIO("\n".join(lines)))
    assert 1.59 < float(second["f (MHz)"]) / float(first["f (MHz)"]) < 1.60
    assert 1e12 < float(first["k₃ (N/m³)"]) < 1e13
    assert first["label"] == ""


def test_latex_is_a_table_of_booktabs(capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*DRUM, "latex"]) == 0
    out = capsys.readouterr().out
    assert out.isascii()
    assert r"f/f$_{1}$ & m\_eff (ng) & $\alpha$ (\textmu{}m$^{-2}$)" in out
    assert out.count(r"\\") == 3
    assert out.endswith("\\bottomrule\n\\end{tabular}\n")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("7.65·10⁻¹²", r"7.65$\cdot$10$^{-12}$"),
        ("χ²/ν", r"$\chi$$^{2}$/$\nu$"),
        ("50 % & more_#", r"50 \% \& more\_\#"),
        ("a\\b{c}", r"a\textbackslash{}b\{c\}"),
        ("−3.1 ± 0.2 °", r"$-$3.1 $\pm$ 0.2 $^\circ$"),
        ("Ω x² y₁₂", r"$\Omega$ x$^{2}$ y$_{12}$"),
    ],
)
def test_signs_become_latex(text: str, expected: str) -> None:
    assert latex(text) == expected


def test_json_by_format_is_json_by_its_own_option(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["geometries", "--json"]) == run(["geometries", "--format", "json"]) == 0
    one, other = capsys.readouterr().out.splitlines()
    assert one == other
    assert json.loads(one)["geometries"]


def test_words_between_tables_leave_standard_output_to_the_tables(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(["validate", "erratum_linewidths", "--format", "csv"]) == 0
    out, err = capsys.readouterr()
    assert out.startswith("# Validation\nquantity,femnl,")
    assert err == "erratum_linewidths: agrees\n"


def test_an_unknown_format_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*DRUM, "docx"]) == 2
    assert (
        capsys.readouterr().err
        == "femnl: --format docx: expected one of text, markdown, latex, csv, json\n"
    )


def test_help_reads_like_a_table_of_contents(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--help"]) == 0
    out = capsys.readouterr().out
    places = [
        out.index(word)
        for word in (
            "A device:",
            "\n  modes ",
            "What a readout shows",
            "\n  maps ",
            "Measurements:",
            "\n  fit ",
            "Trust:",
        )
    ]
    assert places == sorted(places)
    assert "Other commands:" not in out, "give the new command a chapter in femnl/cli/_main.py"


@pytest.mark.parametrize(
    ("words", "position", "expected"),
    [
        ("femnl mo", 1, "modes"),
        ("femnl modes --tens", 2, "--tensor"),
        ("femnl modes tramp", 2, "trampoline"),
    ],
)
def test_the_shell_completes_commands_options_and_geometries(
    words: str, position: int, expected: str, tmp_path: Path
) -> None:
    environment = os.environ | {
        "_FEMNL_COMPLETE": "complete_bash",
        "COMP_WORDS": words,
        "COMP_CWORD": str(position),
        "PYTHONPATH": str(ROOT),
    }
    done = subprocess.run(
        [sys.executable, "-m", "femnl"],
        env=environment,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.split() == [expected]
    assert done.stderr == ""


def test_a_terminal_shows_the_step_and_then_the_result(tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "femnl", *DRUM[:-1], "--json"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        command,
        env=environment,
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=theirs,
        text=True,
        check=True,
    )
    shown = os.read(ours, 2**16).decode()
    assert "circle: meshing …" in shown
    assert "unknowns …" in shown
    assert shown.endswith("\r\x1b[K"), "the line is empty again when the result comes"
    assert json.loads(done.stdout)["geometry"] == "circle"
