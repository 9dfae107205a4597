"""Every case of validation/ holds, and says where its numbers are from."""

from pathlib import Path

import pytest

from femnl.core import resources
from femnl.validation import Row, compare, find, load

PATHS = find(resources.cases())


def marked(path: Path) -> object:
    """The case as a test parameter, slow where it says so."""
    return pytest.param(path, id=path.stem, marks=[pytest.mark.slow] if load(path).slow else [])


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_a_case_says_where_its_numbers_are_from(path: Path) -> None:
    source = load(path).source
    assert len(source.split()) >= 2, f"{path.name}: {source!r} does not lead a reader to the number"
    assert "femnl" not in source.lower(), f"{path.name}: femnl cannot be its own reference"


@pytest.mark.parametrize(
    "path", [path for path in PATHS if path.stem.startswith("erratum_")], ids=lambda path: path.stem
)
def test_an_erratum_states_the_printed_number_and_why_it_is_wrong(path: Path) -> None:
    case = load(path)
    assert any(reference.printed is not None for reference in case.references)
    assert case.why


@pytest.mark.parametrize("path", [marked(path) for path in PATHS])
def test_a_case_holds(path: Path) -> None:
    def line(row: Row) -> str:
        return (
            f"{row.reference.quantity}: {row.value!r} against {row.reference.value!r}, "
            f"{row.distance}: {row.verdict}"
        )

    failed = [line(row) for row in compare(load(path)) if row.verdict != "agrees"]
    assert not failed
