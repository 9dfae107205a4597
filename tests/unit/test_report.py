"""The report: its numbers, what it says of a case that fails, and how it looks in a real browser."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from femnl.errors import ParameterError
from femnl.geometry import load
from femnl.predict import solve_modes, solve_nonlinearity
from femnl.report import Device, Drive, Published, write_report
from femnl.report.blind import blind
from femnl.report.numbers import plain, ppm, with_error
from femnl.report.published import HEXAGON, SQUARE

HOSTILE = "<script>window.hacked = 1</script>"
GEOMETRY = f"""
name = "square-100um"
source = "made up {HOSTILE}"
assumed = ["film.poisson"]
[outline]
kind = "square"
side = "100 um"
[film]
thickness = "200 nm"
young = "250 GPa"
poisson = 0.23
density = "3100 kg/m^3"
stress = "1 GPa"
[readout]
gap = "3226.25 nm"
"""
CASES = {
    "holds": "Case(claim='Two and two is four {hostile}', source='counting fingers', references=(Reference('sum', 4.0, relative=1e-9),), "
    "compute=lambda: [(4.0, 1e-12)])",
    "differs": "Case(claim='Two and two is five', source='a novel', references=(Reference('sum', 5.0, 'm', absolute=0.1),), "
    "compute=lambda: [4.0])",
    "corrects": "Case(claim='π is no 3', source='Archimedes of Syracuse', why='it was rounded too far', "
    "references=(Reference('π', 3.14159265, absolute=1e-6, printed=3.0),), compute=lambda: [3.14159265358979])",
    "breaks": "Case(claim='Nothing is divided by zero', source='counting fingers', references=(Reference('q', 1.0, relative=1e-3),), "
    "compute=lambda: [1 / 0])",
}
PUBLISHED = Published(
    source="made up",
    frequency={"(1,1)": 4.0e6},
    ratio={"(2,2)": 2.0},
    ratio_kind="measured",
    ideal=SQUARE.ideal,
    alpha={"(1,1)": 4e10},
    drives=(Drive("red", 632.8e-9, 4.0),),
    highest=21,
)


@dataclass(frozen=True)
class Written:
    """A report, the geometry that it is about, and what it said while it was made."""

    path: Path
    geometry: Path
    steps: list[str]

    @property
    def text(self) -> str:
        """The page without its pictures."""
        return re.sub(r'src="data:[^"]*"', 'src=""', self.path.read_text(encoding="utf-8"))


@pytest.fixture(scope="session")
def report(tmp_path_factory: pytest.TempPathFactory) -> Written:
    """A report on one small device and four cases, of which one differs and one breaks."""
    folder = tmp_path_factory.mktemp("report")
    geometry = folder / "square-100um.toml"
    geometry.write_text(GEOMETRY, encoding="utf-8")
    cases = folder / "cases"
    cases.mkdir()
    for name, case in CASES.items():
        source = f"from femnl.validation import Case, Reference\nCASE = {case.replace('{hostile}', HOSTILE)}\n"
        (cases / f"{name}.py").write_text(source, encoding="utf-8")
    steps: list[str] = []
    device = Device("Square & small", (str(geometry),), PUBLISHED)
    path = write_report(folder / "out", steps.append, cache=False, devices=[device], cases=cases)
    return Written(path, geometry, steps)


def test_the_report_is_one_file_that_refers_to_nothing_outside_it(report: Written) -> None:
    assert [path.name for path in report.path.parent.iterdir()] == ["index.html"]
    page = report.path.read_text(encoding="utf-8")
    links = re.findall(r'(?:src|href|url)\s*[=(]\s*["\']?([^"\'\s>)]+)', page)
    assert links
    assert all(link.startswith(("#", "data:")) for link in links)


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
        assert f"<td>{with_error(duffing.alpha[0] / 1e9, duffing.alpha_error[0] / 1e9)}</td>" in report.text
    assert ppm(modes.ratio[3], 2.0) in report.text
    assert "201.43 nm" in report.text  # 4 · 632.8 nm / 4π


def test_text_from_files_is_escaped(report: Written) -> None:
    assert HOSTILE not in report.text
    assert report.text.count("&lt;script&gt;window.hacked = 1&lt;/script&gt;") >= 2
    assert "Square &amp; small" in report.text


def test_every_step_is_told_before_it_is_taken(report: Written) -> None:
    assert report.steps[0] == "square-100um: modes"
    assert report.steps[-1] == "page"
    assert [step for step in report.steps if step.startswith("validation")] == [f"validation: {name}" for name in sorted(CASES)]


def test_a_folder_that_cannot_be_made_is_refused_before_anything_is_solved(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    steps: list[str] = []
    with pytest.raises(ParameterError, match="no folder can be made there"):
        write_report(tmp_path / "file" / "out", steps.append)
    assert steps == []


def test_without_opengl_the_report_stops_before_anything_is_solved(tmp_path: Path) -> None:
    for name in ("libEGL.so.1", "libEGL.so", "libOSMesa.so.8", "libOSMesa.so"):
        (tmp_path / name).touch()  # found first, and not a library: as good as absent
    script = "from pathlib import Path\nfrom femnl.report import write_report\nwrite_report(Path('out'), print)"
    environment = os.environ | {"LD_LIBRARY_PATH": str(tmp_path), "PYTHONPATH": str(Path(__file__).parents[2])}
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
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
def test_a_number_carries_the_digits_that_its_error_leaves(value: float, error: float | None, text: str) -> None:
    assert with_error(value, error) == text


@pytest.mark.parametrize(("value", "text"), [(2.000548, "+274 ppm"), (1.99, "−5,000 ppm"), (2.1, "+5.00 %")])
def test_a_difference_is_told_in_ppm_or_in_percent(value: float, text: str) -> None:
    assert ppm(value, 2.0) == text


def test_published_ideal_ratios_are_those_of_the_literature() -> None:
    # Regular hexagon held at its edge: f/f₁ of the first modes to eight digits.
    ratios = [1, 1.5918564, 1.5918564, 2.1296325, 2.1296325, 2.2890245, 2.5800153, 2.7122775, 2.8982817, 2.8982817]
    assert list(HEXAGON.ideal.values()) == pytest.approx(ratios, abs=6e-8)
    assert SQUARE.ideal["(2,1)"] == pytest.approx(2.5**0.5)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """A headless Chromium of the system."""
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    if path is None:
        pytest.skip("no chromium on the PATH")
    switches = ("disable-gpu", "disable-background-networking", "disable-component-update", "disable-sync", "no-first-run", "no-sandbox")
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=path, args=[f"--{switch}" for switch in switches])
        yield chromium
        chromium.close()


def opened(browser: Browser, report: Written, width: int, scheme: str) -> tuple[Page, list[str], list[str]]:
    """The report in a window of a width: the page, what its console said, and what it fetched."""
    page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme="dark" if scheme == "dark" else "light")
    said: list[str] = []
    fetched: list[str] = []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: fetched.append(request.url))
    page.goto(report.path.as_uri())
    return page, said, fetched


@pytest.mark.browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 400])
def test_a_browser_shows_the_report_without_errors_or_sideways_scrolling(
    browser: Browser, report: Written, width: int, scheme: str
) -> None:
    page, said, fetched = opened(browser, report, width, scheme)
    assert said == []
    assert [url for url in fetched if not url.startswith("data:")] == [report.path.as_uri()]
    assert page.evaluate("document.images.length") == 6
    assert page.evaluate("[...document.images].every(image => image.complete && image.naturalWidth > 300 && image.alt)")
    assert page.evaluate("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    # Whatever is wider than the window scrolls within its own frame, which the keyboard can reach.
    frames = "[...document.querySelectorAll('table')].map(table => table.parentElement)"
    assert page.evaluate(f"{frames}.every(frame => frame.className == 'scroll' && frame.tabIndex == 0)")
    assert page.evaluate("typeof window.hacked") == "undefined"
    page.close()


@pytest.mark.browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out_from_its_background(browser: Browser, report: Written, scheme: str) -> None:
    page, _, _ = opened(browser, report, 1280, scheme)
    colours = page.evaluate(
        "['body', 'figcaption', 'nav a', '.good', '.bad'].map(s => getComputedStyle(document.querySelector(s)).color)"
        ".concat(getComputedStyle(document.body).backgroundColor)"
    )
    *inks, paper = [luminance(colour) for colour in colours]
    assert (paper < 0.05) == (scheme == "dark")
    for ink in inks:
        assert (max(ink, paper) + 0.05) / (min(ink, paper) + 0.05) >= 4.5  # WCAG 2.1, AA
    page.close()


def luminance(colour: str) -> float:
    """Relative luminance of an rgb(…) colour as WCAG 2.1 defines it."""
    parts = [int(part) / 255 for part in re.findall(r"\d+", colour)[:3]]
    linear = [part / 12.92 if part <= 0.03928 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.browser
def test_the_report_prints_on_pages_that_cut_no_table(browser: Browser, report: Written) -> None:
    page, _, _ = opened(browser, report, 1280, "dark")
    page.emulate_media(media="print")
    page.set_viewport_size({"width": 703, "height": 1000})  # A4 less its margins
    assert page.evaluate("getComputedStyle(document.body).color") == "rgb(0, 0, 0)"
    assert page.evaluate("[...document.querySelectorAll('.scroll')].every(frame => frame.scrollWidth <= frame.clientWidth + 1)")
    assert page.pdf(prefer_css_page_size=True).startswith(b"%PDF")
    page.close()


def _rate(k: int, n: int, low: float, high: float, *target: object) -> dict[str, Any]:
    rate = {"n": n, "k": k, "rate": k / n, "interval": [low, high], "by_kind": {"map": {"n": n, "k": k, "rate": k / n}}}
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
def test_a_rate_of_the_blind_study_says_whether_it_meets_its_target(rate: dict[str, Any], text: str, tmp_path: Path) -> None:
    board = {"seeds": [7], "draws": 400, "rates": {"named": rate}, "limits": {"map: tilt": {"sigma": 5.2, "draws": 30, "slope": 1e-4}}}
    (tmp_path / "blind.json").write_text(json.dumps(board), encoding="utf-8")
    found = blind(tmp_path)
    assert found is not None
    assert found.rates[0][-1] == text
    assert found.by_kind == [["named", f"{rate['k']} of {rate['n']}"]]
    assert found.limits == [["map: tilt", "5.2", "30", "slope 0.0001"]]


def test_without_a_blind_study_the_page_says_nothing_of_it(tmp_path: Path) -> None:
    assert blind(tmp_path) is None
