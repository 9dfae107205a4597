"""The runner of the validation cases: what agrees, what differs, and nothing broken is hidden."""

import json
import math
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from femnl.core.errors import ParameterError
from femnl.validation import Case, Reference, Row, compare, find, load, record, render, run

CASE = """
from femnl.validation import Case, Reference
ONE = Reference("one", 1.0, "m", absolute=0.1)
CASE = Case(
    claim="one is one",
    source="arithmetic, by hand",
    references=(ONE,),
    compute=lambda: [{value}],
)
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with five cases.

    One agrees, one differs, one crashes, one does not parse, and one file has no case.
    """
    for name, text in {
        "agrees": CASE.format(value="(1.05, 0.06)"),
        "differs": CASE.format(value="1.2"),
        "crashes": CASE.format(value="1 / 0"),
        "garbled": "CASE = (",
        "empty": "",
        "_helper": "raise RuntimeError",
    }.items():
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
    return tmp_path


def test_a_run_hides_neither_failing_nor_crashing_cases(folder: Path) -> None:
    results = {result.name: result for result in run(folder)}
    assert {name for name, result in results.items() if result.passed} == {"agrees"}
    assert sorted(results) == ["agrees", "crashes", "differs", "empty", "garbled"]
    assert results["crashes"].failure == "ZeroDivisionError: division by zero"
    assert results["crashes"].claim == "one is one"
    assert results["garbled"].failure is not None
    assert results["garbled"].failure.startswith("SyntaxError")
    assert "defines no CASE" in str(results["empty"].failure)
    assert results["differs"].failure is None


def test_the_table_and_the_record_show_every_failure(folder: Path) -> None:
    results = list(run(folder))
    console = Console(width=200, record=True, file=(folder / "out").open("w", encoding="utf-8"))
    console.print(render(results))
    console.file.close()
    text = console.export_text()
    for words in (
        "one is one",
        "differs",
        "broken",
        "ZeroDivisionError",
        "SyntaxError",
        "4 of 5 failed",
        "+200,000 ppm",
        "one [m]",
    ):
        assert words in text
    written = json.loads(json.dumps([record(result) for result in results]))
    assert [entry["passed"] for entry in written] == [True, False, False, False, False]
    assert written[0]["rows"][0] == {
        "quantity": "one",
        "unit": "m",
        "value": 1.05,
        "error": 0.06,
        "reference": 1.0,
        "tolerance": 0.1,
        "sd": None,
        "printed": None,
        "difference": pytest.approx(0.05),
        "verdict": "agrees",
    }


def test_words_select_cases_and_a_word_without_a_case_is_refused(folder: Path) -> None:
    assert [path.stem for path in find(folder, ["agrees", "c*"])] == ["agrees", "crashes"]
    with pytest.raises(ParameterError, match="no validation case is named 'agree'"):
        find(folder, ["agree"])


@pytest.mark.parametrize(
    ("reference", "value", "verdict"),
    [
        (Reference("q", 2.0, relative=0.1), 2.19, "agrees"),
        (Reference("q", 2.0, relative=0.1), 2.21, "differs"),
        (Reference("q", -2.0, relative=0.1), -2.21, "differs"),
        (Reference("q", 0.0, absolute=0.1), -0.11, "differs"),
        (Reference("q", 2.0, sd=0.1), 2.29, "agrees"),
        (Reference("q", 2.0, sd=0.1), 1.69, "differs"),
        (Reference("q", 2.0, relative=0.1), math.nan, "differs"),
        (Reference("q", 2.0, relative=0.1), math.inf, "differs"),
        (Reference("q", 2.0, absolute=0.1, printed=3.0), 2.0, "agrees"),
        (Reference("q", 2.0, absolute=0.1, printed=2.05), 2.0, "printed number stands"),
    ],
)
def test_the_verdict_follows_the_tolerance(
    reference: Reference, value: float, verdict: str
) -> None:
    assert Row(reference, value).verdict == verdict


@pytest.mark.parametrize(
    ("reference", "words"),
    [
        (Reference("q", 2.0, relative=0.1), "+500 ppm"),
        (Reference("q", 2.0, sd=0.001), "+1 σ"),
        (Reference("q", 0.0, "Hz", absolute=0.1), "+2 Hz"),
    ],
)
def test_the_difference_is_told_in_the_measure_that_suits_the_reference(
    reference: Reference, words: str
) -> None:
    assert Row(reference, 2.001).distance == words


@pytest.mark.parametrize(
    "tolerance",
    [{}, {"relative": 0.1, "sd": 1.0}, {"absolute": 0.0}, {"relative": math.inf}, {"sd": -1.0}],
)
def test_a_reference_needs_exactly_one_positive_tolerance(tolerance: dict[str, Any]) -> None:
    with pytest.raises(ParameterError, match="one positive tolerance"):
        Reference("q", 1.0, **tolerance)


@pytest.mark.parametrize("missing", ["claim", "source", "references"])
def test_a_case_without_claim_source_or_references_is_refused(missing: str) -> None:
    fields: dict[str, Any] = {
        "claim": "c",
        "source": "s",
        "references": (Reference("q", 1.0, absolute=1.0),),
        "compute": list,
    } | {missing: ""}
    with pytest.raises(ParameterError, match=f"{missing} is empty"):
        Case(**fields)


def test_an_erratum_without_a_reason_is_refused() -> None:
    with pytest.raises(ParameterError, match="`why` is empty"):
        Case("c", "s", (Reference("q", 1.0, absolute=0.1, printed=2.0),), list)


def test_values_and_references_go_one_to_one() -> None:
    with pytest.raises(ParameterError, match="2 values for 1 references"):
        compare(Case("c", "s", (Reference("q", 1.0, absolute=0.1),), lambda: [1.0, 2.0]))


def test_a_file_that_is_no_python_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    path.write_text("", encoding="utf-8")
    with pytest.raises(ParameterError, match="not a Python file"):
        load(path)
