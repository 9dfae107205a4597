"""The laboratory shares no model and no formula with what diagnoses its files."""

import ast
from pathlib import Path

import pytest

from femnl.effects import library
from tests.blind.forms import LAB, PAGE, derived, formulas, library_formulas, page
from tests.blind.lab import KINDS, causes

FILES = sorted(LAB.rglob("*.py"))
ALLOWED = ("femnl.core", "femnl.device", "femnl.io")
"""What a file or a geometry is; no physics."""
DEFINITIONS = (
    "12 * (1 - film.poisson ** 2)",
    "self.noise * (noise[0] + 1j * noise[1])",
    "1 / (1 + 2j * (self.frequency - self.f0) / self.width)",
    "centre ** 2 - frequency ** 2 + 1j * frequency * width",
)
"""Definitions, which have one form: the bending stiffness of a plate, noise in both quadratures,
the response of a linear resonance near it and far from it.
"""


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_the_laboratory_imports_no_model_of_the_library(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    names = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    names += [a.name for node in ast.walk(tree) if isinstance(node, ast.Import) for a in node.names]
    own = [name for name in names if name.split(".")[0] == "femnl"]
    assert [name for name in own if not name.startswith(ALLOWED)] == []


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_the_laboratory_restates_no_formula_of_the_library(path: Path) -> None:
    known = library_formulas()
    shared = {text: known[form] for form, text in formulas(path).items() if form in known}
    assert {a: b for a, b in shared.items() if not any(d in a for d in DEFINITIONS)} == {}


def test_a_formula_is_known_under_other_names_and_in_another_order(tmp_path: Path) -> None:
    one = tmp_path / "one.py"
    other = tmp_path / "other.py"
    one.write_text("y = a['f'] * (1 + b * p + c * p**2)", encoding="utf-8")
    other.write_text("z = (pull * power + bend * power**2 + 1) * self.frequency", encoding="utf-8")
    assert formulas(one).keys() & formulas(other).keys()


def test_every_cause_has_a_form_of_its_own_in_the_laboratory() -> None:
    ways = derived()
    assert {name for kind in KINDS for name in causes(kind)} == ways.keys()
    assert ways.keys() == library().keys()


def test_the_page_lists_both_forms_as_they_are() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "run python -m tests.blind.forms"
