"""Every cause states how strong it can be and why; beyond that it is not named."""

from io import StringIO

import pytest
from rich.console import Console

from femnl.cli._main import run
from femnl.cli._output import table
from femnl.effects import library

PARAMETERS = [(e.name, p) for e in library().values() for p in e.parameters]


@pytest.mark.parametrize(
    ("name", "parameter"), PARAMETERS, ids=[f"{name}.{p.name}" for name, p in PARAMETERS]
)
def test_every_range_has_its_reason(name: str, parameter: object) -> None:
    assert len(getattr(parameter, "reason", "").split()) >= 3


@pytest.mark.parametrize("name", library())
def test_the_command_shows_the_bounds_of_each_cause_and_why(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["effects", name]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    for parameter in library()[name].parameters:
        assert " ".join(parameter.reason.split()[:6]) in shown


def test_a_name_that_is_none_gets_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["effects", "wind"]) == 2
    assert capsys.readouterr().err == "femnl: wind: no such effect; `femnl effects` lists them\n"


def test_units_are_shown_and_are_no_markup(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["effects"]) == 0
    assert "mass [kg], x [m], y [m]" in capsys.readouterr().out


def test_a_narrow_terminal_wraps_sentences_and_cuts_no_name() -> None:
    rows = [[e.name, e.equation, ", ".join(e.kinds)] for e in library().values()]
    out = StringIO()
    Console(width=80, file=out).print(table("Effects", ["name", "equation", "shows in"], rows))
    shown = out.getvalue()
    assert shown.count("…") == sum(e.equation.count("…") for e in library().values())
    assert all(f"{name} " in shown for name in library())
