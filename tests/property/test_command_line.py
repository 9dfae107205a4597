"""Whatever words are put together, the command answers or says in one line why not."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from femnl.cli._main import run

MANY = settings(
    derandomize=True,
    database=None,
    deadline=None,
    max_examples=80,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
COMMANDS = [
    "bands",
    "geometries",
    "effects",
    "show",
    "mesh",
    "import",
    "fit",
    "diagnose",
    "maps",
    "modes",
    "nonsense",
    "sweep",
    "view",
]
OPTIONS = [
    "--json",
    "--out",
    "--z",
    "--count",
    "--symmetry",
    "--format",
    "--points",
    "--geometry",
    "--use",
    "--edge",
    "--mode",
    "-n",
    "--",
]
VALUES = [
    "",
    "0",
    "-1",
    "nan",
    "1e400",
    "none.nc",
    "none.toml",
    "nowhere",
    "nowhere/x.nc",
    "é\n",
    "\0",
    "a" * 300,
    "hinged",
    "latex",
    "../x",
]


@given(
    st.sampled_from(COMMANDS),
    st.lists(st.sampled_from([*OPTIONS, *VALUES]) | st.text(max_size=8), max_size=5),
)
@MANY
def test_any_words_are_answered_or_refused_in_one_line(
    capsys: pytest.CaptureFixture[str], command: str, words: list[str]
) -> None:
    status = run([command, *words])
    out, err = capsys.readouterr()
    assert status in (0, 2)
    if status == 2:
        assert err.startswith("femnl: ")
        assert err.count("\n") == 1
        assert out == "" or command in ("mesh", "show")
