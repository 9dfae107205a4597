"""Hostile and unlucky inputs get an answer or one line: no traceback, hang or blow-up of memory.

The cases are drawn; `make hostile` draws thousands of each class.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CASES = {
    "scale": 4,
    "texts": 4,
    "labfiles": 8,
    "layouts": 5,
    "chips": 4,
    "bombs": 4,
    "disk": 3,
}
"""Cases of each class that a few seconds allow."""
MANY = 300


def faults(folder: Path, kind: str, cases: int, first: int) -> list[dict[str, object]]:
    """Return the cases of a class that have a fault."""
    command = [sys.executable, "-m", "tests.robust.hostile.study", str(folder)]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    subprocess.run(
        [*command, str(cases), str(first), kind],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        check=False,
    )
    lines = (folder / "cases.jsonl").read_text(encoding="utf-8").splitlines()
    assert len(lines) == cases
    return [case for line in lines if (case := json.loads(line))["faults"]]


@pytest.mark.parametrize("kind", sorted(CASES))
def test_a_hostile_case_gets_an_answer_or_one_line(kind: str, tmp_path: Path) -> None:
    assert faults(tmp_path, kind, CASES[kind], first=100) == []


@pytest.mark.slow
@pytest.mark.parametrize("kind", [*sorted(CASES), "controls", "nonsense", "options", "streams"])
def test_none_of_many_hostile_cases_has_a_fault(kind: str, tmp_path: Path) -> None:
    assert faults(tmp_path, kind, MANY, first=50_000) == []
