"""The pages of the documentation that are made from the code, and the font of its formulas."""

import re
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from fontTools.ttLib import TTFont

from femnl.cli._main import run
from femnl.effects import library

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def pages() -> Iterator[Any]:
    """The module beside the documentation that writes the pages."""
    sys.path.insert(0, str(DOCS))
    yield import_module("generated_pages")
    sys.path.remove(str(DOCS))


def test_a_page_of_a_command_has_every_option_that_its_help_has(
    pages: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in pages.command_names():
        assert run([name, "--help"]) == 0
        options = set(re.findall(r"^\s+(?:-\w, )?(--[\w-]+)", capsys.readouterr().out, re.M))
        shown = re.findall(r"\* - ``(?:-\w, )?(--[\w-]+)", pages.command_page(name))
        assert set(shown) == options
        assert "--help" in shown


def test_every_example_of_a_command_is_on_its_page(pages: Any) -> None:
    text = (DOCS / "reference" / "commands.md").read_text(encoding="utf-8")
    lines = re.findall(r"^    (femnl (\S+).*)$", text, re.MULTILINE)
    assert len(lines) > 40
    for line, name in lines:
        assert f"   {line}\n" in pages.command_page(name)


def test_every_cause_has_a_page_with_all_that_its_file_says(pages: Any) -> None:
    contents = pages.effects_page()
    for effect in library().values():
        assert f"   {effect.name}\n" in contents
        page = pages.effect_page(effect).replace("\\", "")
        imitated = [f"of {name}" for parts in effect.imitates.values() for name in parts]
        told = [name.replace("of unknown", "of what no library has") for name in imitated]
        told += [effect.equation, effect.source, effect.limits, effect.accuracy_reason]
        for text in told:
            assert " ".join(text.replace("`", "``").split()) in " ".join(page.split())
        for parameter in effect.parameters:
            assert f"* - ``{parameter.name}``" in page


def test_a_mark_of_restructured_text_in_a_text_is_shown_and_not_obeyed(pages: Any) -> None:
    assert pages._escaped("*a* |b| c_ `d*` e") == r"\*a\* \|b\| c\_ ``d*`` e"
    assert pages._escaped("one ` alone") == r"one \` alone"


def test_the_font_of_formulas_can_set_those_of_the_pages() -> None:
    font = TTFont(DOCS / "static" / "math.woff")
    assert "MATH" in font  # without it, scripts stand beside their letters
    greek = "αβγδεζηθκλμνξπρστφχψωΓΔΘΛΞΠΣΦΨΩ∂∇∑∫√≤≥≪≈·×−±"
    italic = "".join(chr(0x1D434 + k) for k in range(26) if k != 33)
    characters = font.getBestCmap()
    assert characters is not None
    missing = {c for c in greek + italic if ord(c) not in characters}
    assert missing == set()
    css = (DOCS / "static" / "site.css").read_text(encoding="utf-8")
    assert 'url("math.woff")' in css
