"""The report: its numbers, failing cases, the blind study and the benchmarks."""

import html
import json
import os
import re
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from femnl.core import resources
from femnl.core.errors import ParameterError
from femnl.core.numbers import plain, ppm, with_error
from femnl.device.geometry import load
from femnl.pipeline import solve_modes, solve_nonlinearity
from femnl.report import write_device, write_report
from femnl.report.benchmarks import benchmarks
from femnl.report.blind import UNIFORM, Blind, blind
from femnl.report.published import HEXAGON, SQUARE
from tests.unit.report_page import CASES, HOSTILE, Written


def test_the_report_is_one_file_that_refers_to_nothing_outside_it(report: Written) -> None:
    assert [path.name for path in report.path.parent.iterdir()] == ["index.html"]
    # Which a browser watches
    page = re.sub(
        r"<script>.*?</script>", "", report.path.read_text(encoding="utf-8"), flags=re.DOTALL
    )
    links = re.findall(r'(?:src|href|url)\s*[=(]\s*["\']?([^"\'\s>)]+)', page)
    assert links
    assert all(link.startswith(("#", "data:")) for link in links)
    assert not re.search(r"<script[^>]*\ssrc", report.path.read_text(encoding="utf-8"))


def test_the_report_counts_what_agrees_and_names_what_does_not(report: Written) -> None:
    assert "<b>2 of 3</b>numbers agree" in report.text
    assert "<b>2 of 4</b>cases hold" in report.text
    assert "These cases do not hold: breaks, differs." in report.text
    assert "broke off: ZeroDivisionError" in report.text
    assert "Every number is within the tolerance" not in report.text


def test_an_erratum_stands_with_the_printed_and_the_right_number(report: Written) -> None:
    errata = report.text[report.text.index('id="errata"') : report.text.index('id="device-1"')]
    assert "it was rounded too far" in errata
    assert re.search(r"<td>3</td><td>3\.141593</td><td>3\.141593</td>.*✓ corrected", errata)
    assert "Two and two" not in errata


def test_the_report_prints_what_the_library_computes(report: Written) -> None:
    modes = solve_modes(load(report.geometry), cache=False)
    assert with_error(modes.ratio[3], modes.ratio_error[3]) in report.text
    assert f"<td>{plain(modes.effective_mass[0] * 1e12, 5)}</td>" in report.text
    for edge in ("clamped", "sliding", "paper"):
        duffing = solve_nonlinearity(modes, edge)
        assert (
            f"<td>{with_error(duffing.alpha[0] / 1e9, duffing.alpha_error[0] / 1e9)}</td>"
            in report.text
        )
    assert ppm(modes.ratio[3], 2.0) in report.text
    assert "201.43 nm" in report.text  # 4 · 632.8 nm / 4π


def test_a_case_that_holds_is_folded_and_one_that_does_not_is_open(report: Written) -> None:
    folds = re.findall(r"<details( open)?>\s*<summary>.*?<small>(\w+),", report.text)
    assert {name: bool(is_open) for is_open, name in folds} == {
        "holds": False,
        "differs": True,
        "corrects": False,
        "breaks": True,
    }


@pytest.mark.slow
def test_a_report_on_one_device_says_nothing_of_what_femnl_is_checked_against(
    report: Written, tmp_path: Path
) -> None:
    page = write_device(report.geometry, tmp_path / "out", lambda step: None, cache=False)
    text = re.sub(r"<script.*?</script>", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    modes = solve_modes(load(report.geometry), cache=False)
    assert with_error(modes.frequency[0] / 1e6, modes.frequency_error[0] / 1e6) in text
    assert "<h1>square-100um</h1>" in text
    assert HOSTILE not in text
    assert "film.poisson assumed" in text
    for absent in ("errata", "checks", "blind", "benchmarks"):
        assert f'id="{absent}"' not in text
        assert f'href="#{absent}"' not in text


def test_text_from_files_is_escaped(report: Written) -> None:
    assert HOSTILE not in report.text
    assert report.text.count("&lt;script&gt;window.hacked = 1&lt;/script&gt;") >= 2
    assert "Square &amp; small" in report.text


def test_every_step_is_told_before_it_is_taken(report: Written) -> None:
    assert report.steps[0] == "square-100um: modes"
    assert report.steps[-1] == "page"
    assert [step for step in report.steps if step.startswith("validation")] == [
        f"validation: {name}" for name in sorted(CASES)
    ]


def test_a_folder_that_cannot_be_made_is_refused_before_anything_is_solved(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    steps: list[str] = []
    with pytest.raises(ParameterError, match="no folder can be made there"):
        write_report(tmp_path / "file" / "out", steps.append)
    assert steps == []


def test_without_opengl_the_report_stops_before_anything_is_solved(tmp_path: Path) -> None:
    for name in ("libEGL.so.1", "libEGL.so", "libOSMesa.so.8", "libOSMesa.so"):
        (tmp_path / name).touch()  # found first, and not a library: as good as absent
    script = (
        "from pathlib import Path\nfrom femnl.report import "
        "write_report\nwrite_report(Path('out'), print)"
    )
    environment = os.environ | {
        "LD_LIBRARY_PATH": str(tmp_path),
        "PYTHONPATH": str(Path(__file__).parents[2]),
    }
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert done.stdout == ""
    assert "MissingLibraryError: pictures need OpenGL without a display" in done.stderr


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (1.58137204, 1.99e-6, "1.581372 ± 0.000002"),
        (-12.3456, 0.04, "−12.35 ± 0.04"),
        (861.4, 7.2, "861 ± 7"),
        (5.761413e9, 6.1e4, "(5.76141 ± 0.00006)·10⁹"),
        (2.5e-16, 3e-18, "(2.50 ± 0.03)·10⁻¹⁶"),
        (8.63e-7, 4.2e-10, "(8.630 ± 0.004)·10⁻⁷"),
        (1e-9, 1.0, "0 ± 1"),
        (0.0, 0.1, "0.0 ± 0.1"),
        (1.5, 1e-14, "1.5"),
        (4.0, 0.0, "4"),
        (4.25, float("inf"), "4.25"),
        (8.7e-7, None, "8.7·10⁻⁷"),
    ],
)
def test_a_number_carries_the_digits_that_its_error_leaves(
    value: float, error: float | None, text: str
) -> None:
    assert with_error(value, error) == text


@pytest.mark.parametrize(
    ("value", "text"), [(2.000548, "+274 ppm"), (1.99, "−5,000 ppm"), (2.1, "+5.00 %")]
)
def test_a_difference_is_told_in_ppm_or_in_percent(value: float, text: str) -> None:
    assert ppm(value, 2.0) == text


def test_published_ideal_ratios_are_those_of_the_literature() -> None:
    # Regular hexagon held at its edge: f/f₁ of the first modes to eight digits.
    ratios = [
        1,
        1.5918564,
        1.5918564,
        2.1296325,
        2.1296325,
        2.2890245,
        2.5800153,
        2.7122775,
        2.8982817,
        2.8982817,
    ]
    assert list(HEXAGON.ideal.values()) == pytest.approx(ratios, abs=6e-8)
    assert SQUARE.ideal["(2,1)"] == pytest.approx(2.5**0.5)


def _rate(k: int, n: int, low: float, high: float, *target: object) -> dict[str, Any]:
    rate = {
        "n": n,
        "k": k,
        "rate": k / n,
        "interval": [low, high],
        "by_kind": {"map": {"n": n, "k": k, "rate": k / n}},
    }
    return rate | ({"target": list(target)} if target else {})


@pytest.mark.parametrize(
    ("rate", "text"),
    [
        (_rate(0, 400, 0.0, 0.009, "at most", 0.02), "≤ 2 %: met"),
        (_rate(0, 100, 0.0, 0.036, "at most", 0.02), "≤ 2 %: not decided by so few draws"),
        (_rate(9, 100, 0.04, 0.16, "at most", 0.02), "≤ 2 %: missed"),
        (_rate(90, 100, 0.82, 0.95, "at least", 0.97), "≥ 97 %: missed"),
        (_rate(65, 100, 0.55, 0.74, "within", 0.68), "64 … 72 %: met"),
        (_rate(50, 100, 0.4, 0.6, "within", 0.68), "64 … 72 %: missed"),
    ],
)
def test_a_rate_of_the_blind_study_says_whether_it_meets_its_target(
    rate: dict[str, Any], text: str, tmp_path: Path
) -> None:
    board = {
        "seeds": [7],
        "draws": 400,
        "rates": {"named": rate},
        "limits": {"map: tilt": {"sigma": 5.2, "draws": 30, "slope": 1e-4}},
    }
    board |= {
        "p_value_uniform": {
            "n": 400,
            "ks_p_value": 0.5,
            "by_kind": {"map": {"n": 400, "ks_p_value": 0.0012}},
        }
    }
    whole = {"femnl_blind": "1.1", "weak": board}
    (tmp_path / "blind.json").write_text(json.dumps(whole), encoding="utf-8")
    (found,) = blind(tmp_path)
    assert found.rates[0][-1] == text
    assert found.by_kind == [["named", f"{rate['k']} of {rate['n']}"], [UNIFORM, "0.0012"]]
    assert found.limits == [["map: tilt", "5.2", "30", "slope 0.0001"]]


def test_without_a_blind_study_the_page_says_nothing_of_it(tmp_path: Path) -> None:
    assert blind(tmp_path) == []


@cache
def studies() -> list[Blind]:
    """The studies of the scoreboard, weak and realistic, with their pictures."""
    return blind(resources.cases())


def test_the_figures_of_the_blind_study_count_the_draws_that_its_rates_count() -> None:
    board = json.loads((resources.cases() / "blind.json").read_text(encoding="utf-8"))["weak"]
    found = studies()[0]
    assert len(found.pictures) == 2
    confusion = board["confusion"]
    rates = board["rates"]
    none = dict(
        zip(
            confusion["answers"], confusion["draws"][confusion["hidden"].index("none")], strict=True
        )
    )
    assert sum(none.values()) == rates["false alarms"]["n"]
    assert sum(none.values()) - none["adequate"] == rates["false alarms"]["k"]
    strong = [
        sigma
        for draws in board["detection"].values()
        for part in draws.values()
        for sigma in part
        if sigma >= 5
    ]
    assert len(strong) == rates["cause named"]["n"]
    assert (
        sum(sigma >= 5 for draws in board["detection"].values() for sigma in draws["named"])
        == rates["cause named"]["k"]
    )


def test_the_realistic_study_on_the_page_counts_what_its_board_counts() -> None:
    board = json.loads((resources.cases() / "blind.json").read_text(encoding="utf-8"))["realistic"]
    found = studies()[1]
    assert found.draws == board["draws"]
    assert len(found.pictures) == 3
    assert found.rates[0][:2] == [
        "hidden cause named, and nothing else",
        f"{board['rates']['named']['k']} of {board['rates']['named']['n']}",
    ]
    near = [s for s in board["shares"] if abs(s["told"] - s["true"]) <= 0.1]
    assert len(near) == board["rates"]["shares"]["k"]
    confusion = board["confusion"]
    none = confusion["draws"][confusion["hidden"].index("none")]
    assert sum(none) == board["rates"]["false alarm"]["n"]
    missed = sum(none) - none[confusion["answers"].index("adequate")]
    assert missed == board["rates"]["false alarm"]["k"]


def test_a_benchmark_says_on_which_machine_and_beside_what_it_ran(tmp_path: Path) -> None:
    table = {"head": ["run", "time (s)"], "rows": [["femnl", 1.23456], ["none", None]]}
    found = {
        "caption": "A race.",
        "command": "python -m benchmarks.race",
        "date": "2026-01-02",
        "seconds": 12.3,
        "cpu_seconds": 9.0,
    }
    machine = {
        "load_before": 2.5,
        "processor": "abacus",
        "system": "desk",
        "threads": "fingers: 10",
    }
    (tmp_path / "benchmarks.json").write_text(
        json.dumps({"race": found | machine | {"tables": [table]}}), encoding="utf-8"
    )
    (race,) = benchmarks(tmp_path)
    assert race.words == (
        "python -m benchmarks.race, 2026-01-02: 12.3 s beside other programs (load 2.5 before "
        "it), 9 s of processor time in all processes; abacus, desk, fingers: 10."
    )
    assert race.tables == [(["run", "time (s)"], [["femnl", "1.23"], ["none", "–"]])]
    assert benchmarks(tmp_path / "none") == []


def test_shipped_benchmarks_are_on_the_page(report: Written) -> None:
    shipped = benchmarks(resources.cases())
    assert shipped
    for benchmark in shipped:
        assert benchmark.words in html.unescape(report.text)
