"""The documentation does what it says.

Every command, every line of Python and every example on it is run.
"""

import re
import runpy
import shlex
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from femnl.cli._main import run
from femnl.core import resources

ROOT = Path(__file__).parents[1]
PAGES = sorted((ROOT / "docs").rglob("*.md"))
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FILE = re.compile(r"# file: (\S+)\n")
# The others solve devices
QUICK = (
    "geometry-format",
    "kind",
    "architecture",
    "chip",
    "commands",
    "degeneracies",
    "diagnosis-json",
    "effect",
    "fit",
    "import",
    "index",
    "measurement-format",
    "plugins",
    "ring-downs",
    "validation",
)


@pytest.fixture(autouse=True)
def _own_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(p, id=p.stem, marks=[] if p.stem in QUICK else [pytest.mark.slow])
        for p in PAGES
        if "_build" not in p.parts
    ],
)
def test_what_a_page_tells_to_do_can_be_done(page: Path, tmp_path: Path) -> None:
    variables: dict[str, object] = {}
    for kind, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        named = FILE.match(text)
        if named is not None:
            (tmp_path / named[1]).parent.mkdir(exist_ok=True)
            (tmp_path / named[1]).write_text(text[named.end() :], encoding="utf-8")
        elif kind == "python":
            exec(compile(text, str(page), "exec"), variables)
        elif kind == "sh":
            for line in text.splitlines():
                command, *words = shlex.split(line, comments=True)
                assert command == "femnl", line
                assert run(words) == 0, line
        else:
            pytest.fail(f"a block of {kind}, which no test runs")


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_draws_a_figure(example: Path) -> None:
    assert any(isinstance(value, Figure) for value in runpy.run_path(str(example)).values())


def test_the_page_of_errata_names_every_case() -> None:
    page = (ROOT / "docs" / "explanation" / "errata.md").read_text(encoding="utf-8")
    cases = {path.stem for path in resources.cases().glob("erratum_*.py")}
    assert cases
    assert cases == set(re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE))


def test_every_page_is_reached_from_the_first() -> None:
    docs = ROOT / "docs"
    lists = [docs / "index.md", docs / "adr" / "index.md"]
    listed = {
        (listing.parent / line).relative_to(docs).as_posix()
        for listing in lists
        for line in listing.read_text(encoding="utf-8").splitlines()
        if (listing.parent / f"{line}.md").is_file()
    }
    names = {page.relative_to(docs).with_suffix("").as_posix() for page in PAGES}
    assert {name for name in names if "_build" not in name} <= listed | {"index"}
