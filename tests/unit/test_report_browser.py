"""The report in a real browser.

No errors, nothing fetched, readable at any width, in dark and light, on paper; a shape that turns.
"""

import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from matplotlib import image
from numpy.typing import NDArray
from playwright.sync_api import Browser, Page, sync_playwright

from femnl.cli._main import run
from femnl.core.errors import MissingLibraryError, ParameterError
from femnl.diagnose import diagnose
from femnl.io import measurement
from femnl.report.diagnosis import write_diagnosis
from femnl.report.paper import find_browser, print_page
from tests.unit.report_page import Written

QUIET = (
    "disable-background-networking",
    "disable-component-update",
    "disable-sync",
    "no-first-run",
    "no-sandbox",
)
WEBGL = ("use-angle=swiftshader", "enable-unsafe-swiftshader")
# Chromium's advice to plotly.js, which reads a small canvas back for each word along an axis.
ADVICE = "Canvas2D: Multiple readback operations using getImageData are faster"


@pytest.fixture(scope="module")
def launch() -> Iterator[Callable[..., Browser]]:
    """Start a headless Chromium of the system with switches of its own."""
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    if path is None:
        pytest.skip("no chromium on the PATH")
    with sync_playwright() as playwright, ExitStack() as stack:

        def start(*switches: str) -> Browser:
            browser = playwright.chromium.launch(
                executable_path=path, args=[f"--{switch}" for switch in (*QUIET, *switches)]
            )
            stack.callback(browser.close)
            return browser

        yield start


@pytest.fixture(scope="module")
def browser(launch: Callable[..., Browser]) -> Browser:
    """A browser that draws in three dimensions."""
    return launch(*WEBGL)


@pytest.fixture(scope="module")
def flat_browser(launch: Callable[..., Browser]) -> Browser:
    """A browser that draws nothing in three dimensions, which takes seconds a page here."""
    return launch("disable-3d-apis")


def opened(
    browser: Browser, report: Written, width: int, scheme: str
) -> tuple[Page, list[str], list[str]]:
    """The report in a window of a width: the page, what its console said, and what it fetched."""
    page = browser.new_page(
        viewport={"width": width, "height": 900},
        color_scheme="dark" if scheme == "dark" else "light",
    )
    said: list[str] = []
    fetched: list[str] = []
    page.on(
        "console",
        lambda message: None if message.text.startswith(ADVICE) else said.append(message.text),
    )
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: fetched.append(request.url))
    page.goto(report.path.as_uri())
    return page, said, fetched


@pytest.mark.browser
@pytest.mark.parametrize(
    ("width", "scheme"),
    [
        (1280, "light"),
        (400, "dark"),
        *(pytest.param(*one, marks=pytest.mark.slow) for one in ((1280, "dark"), (400, "light"))),
    ],
)
def test_a_browser_shows_the_report_without_errors_or_sideways_scrolling(
    browser: Browser, report: Written, width: int, scheme: str
) -> None:
    page, said, fetched = opened(browser, report, width, scheme)
    assert said == []
    assert [url for url in fetched if not url.startswith("data:")] == [report.path.as_uri()]
    assert page.evaluate("document.images.length") == 13
    assert page.evaluate(
        "[...document.images].every(image => image.complete && image.naturalWidth > 300 && "
        "image.alt)"
    )
    assert page.evaluate(
        "document.documentElement.scrollWidth <= document.documentElement.clientWidth"
    )
    # Whatever is wider than the window scrolls within its own frame, which the keyboard can reach.
    frames = "[...document.querySelectorAll('table')].map(table => table.parentElement)"
    assert page.evaluate(
        f"{frames}.every(frame => frame.className == 'scroll' && frame.tabIndex == 0)"
    )
    assert page.evaluate("typeof window.hacked") == "undefined"
    page.close()


@pytest.mark.browser
@pytest.mark.parametrize("width", [1280, 390])
def test_the_contents_stay_in_sight_and_lead_to_what_they_name(
    flat_browser: Browser, report: Written, width: int
) -> None:
    page, _, _ = opened(flat_browser, report, width, "light")
    page.locator("nav a[href='#made-with']").click()
    assert page.locator("nav a[href='#summary']").is_visible()
    nav = page.locator("nav").bounding_box()
    heading = page.locator("#made-with h2").bounding_box()
    assert nav is not None
    assert heading is not None
    assert 0 <= nav["y"] < 100
    # Not under the row of a narrow window
    assert heading["y"] >= (0 if width == 1280 else nav["y"] + nav["height"])
    page.close()


@pytest.mark.browser
@pytest.mark.parametrize("width", [1280, 390])
def test_a_diagnosis_defines_its_words_within_the_window(
    flat_browser: Browser, tmp_path: Path, width: int
) -> None:
    pressure = np.linspace(0, 300, 12)
    quality = 1 / (1 / 2e5 + 3e-8 * pressure)
    data = measurement.series(
        {"pressure": pressure}, quality_factor=quality, quality_factor_sd=0.01 * quality
    )
    measurement.write(measurement.bundle({"q": data}, geometry="square-270um"), tmp_path / "gas.nc")
    path = write_diagnosis(diagnose(tmp_path / "gas.nc"), tmp_path)
    page = flat_browser.new_page(viewport={"width": width, "height": 900})
    page.goto(path.as_uri())
    assert page.evaluate(
        "document.documentElement.scrollWidth <= document.documentElement.clientWidth"
    )
    terms = page.locator(".term")
    assert terms.count() >= 6
    for term in terms.all():
        words = term.locator("[role=tooltip]")
        assert not words.is_visible()
        term.focus()
        assert words.is_visible()
        box = words.bounding_box()
        assert box is not None
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= width
        page.evaluate("document.activeElement.blur()")
    page.close()


@pytest.mark.browser
def test_paper_shows_what_a_screen_folds(flat_browser: Browser, report: Written) -> None:
    page, _, _ = opened(flat_browser, report, 1280, "light")
    folded = page.locator("details:not([open]) td").first
    assert not folded.is_visible()
    page.emulate_media(media="print")
    assert folded.is_visible()
    page.close()


@pytest.mark.browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out_from_its_background(
    flat_browser: Browser, report: Written, scheme: str
) -> None:
    page, _, _ = opened(flat_browser, report, 1280, scheme)
    colours = page.evaluate(
        "['body', 'figcaption', 'nav a', '.good', '.bad'].map(s => "
        "getComputedStyle(document.querySelector(s)).color).concat(getComputedStyle(document.body).backgroundColor)"
    )
    *inks, paper = [luminance(colour) for colour in colours]
    assert (paper < 0.05) == (scheme == "dark")
    for ink in inks:
        assert (max(ink, paper) + 0.05) / (min(ink, paper) + 0.05) >= 4.5  # WCAG 2.1, AA
    page.close()


def luminance(colour: str) -> float:
    """Relative luminance of an rgb(…) colour as WCAG 2.1 defines it."""
    parts = [int(part) / 255 for part in re.findall(r"\d+", colour)[:3]]
    linear = [
        part / 12.92 if part <= 0.03928 else ((part + 0.055) / 1.055) ** 2.4 for part in parts
    ]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.browser
def test_the_report_prints_on_pages_that_cut_no_table(browser: Browser, report: Written) -> None:
    page, _, _ = opened(browser, report, 1280, "dark")
    page.emulate_media(media="print")
    page.set_viewport_size({"width": 703, "height": 1000})  # A4 less its margins
    assert page.evaluate("getComputedStyle(document.body).color") == "rgb(0, 0, 0)"
    assert page.locator("#shape img").is_visible()
    assert not page.locator("#shape-scene").is_visible()
    assert page.evaluate(
        "[...document.querySelectorAll('.scroll')].every(frame => frame.scrollWidth <= "
        "frame.clientWidth + 1)"
    )
    page.close()


@pytest.mark.browser
def test_the_report_is_printed_to_a_pdf_of_a4_pages_beside_it(
    report: Written, tmp_path: Path
) -> None:
    page = Path(shutil.copy(report.path, tmp_path))
    try:
        pdf = print_page(page, find_browser())
    except MissingLibraryError as error:
        pytest.skip(str(error))
    content = pdf.read_bytes()
    assert pdf == tmp_path / "index.pdf"
    assert content.startswith(b"%PDF")
    assert 4 <= len(re.findall(rb"/Type\s*/Page\b", content)) <= 30
    for sides in re.findall(rb"/MediaBox\s*\[([^\]]*)\]", content):
        assert [float(side) for side in sides.split()] == pytest.approx(
            [0, 0, 594.96, 841.92], abs=1
        )


@pytest.mark.browser
def test_a_browser_that_prints_nothing_is_one_line_and_no_file(
    report: Written, tmp_path: Path
) -> None:
    page = Path(shutil.copy(report.path, tmp_path))
    with pytest.raises(
        ParameterError,
        match=r"index\.pdf: .*true did not print it \(status 0\); print .* from a browser$",
    ):
        print_page(page, str(shutil.which("true")))
    assert [path.name for path in tmp_path.iterdir()] == ["index.html"]


def test_without_a_browser_the_pdf_is_refused_before_anything_is_solved(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert run(["report", "--pdf", "--out", str(tmp_path / "report")]) == 2
    assert capsys.readouterr().err == (
        "femnl: a PDF is printed by Chromium or Chrome, and none is on the PATH; install one, "
        "or print the page from a "
        "browser\n"
    )
    assert not (tmp_path / "report").exists()


def look(page: Page) -> NDArray[np.float64]:
    """The scene as the reader sees it: (height, width, 3), 0 to 1."""
    page.wait_for_function(
        "document.querySelector('#shape-scene canvas') && "
        "document.getElementById('shape-scene')._fullLayout.scene._scene"
    )
    page.wait_for_timeout(400)
    return np.asarray(
        image.imread(BytesIO(page.locator("#shape-scene").screenshot()))[..., :3], dtype=np.float64
    )


def coloured(seen: NDArray[np.float64]) -> dict[str, float]:
    """Shares of the picture that are clearly red and clearly blue."""
    excess = seen[..., 0] - seen[..., 2]
    return {"red": float(np.mean(excess > 0.2)), "blue": float(np.mean(excess < -0.2))}


@pytest.mark.browser
@pytest.mark.parametrize(
    ("width", "scheme"), [(1280, "light"), pytest.param(400, "dark", marks=pytest.mark.slow)]
)
def test_the_shape_shows_the_chosen_mode_and_turns_when_it_is_dragged(
    browser: Browser, report: Written, width: int, scheme: str
) -> None:
    page, said, _ = opened(browser, report, width, scheme)
    page.locator("#shape-scene").scroll_into_view_if_needed()
    first = look(page)
    assert coloured(first)["red"] > 0.03
    page.locator("#shape-mode").select_option("3")
    fourth = look(page)
    upper = fourth[: -fourth.shape[0] // 5]  # without the colour bar
    assert min(coloured(upper).values()) > 0.01
    page.locator("#shape-mode").select_option("0")
    assert np.mean(np.abs(look(page) - first)) < 1e-3
    box = page.locator("#shape-scene").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] / 2 + 90, box["y"] + box["height"] / 2, steps=5)
    page.mouse.up()
    assert np.mean(np.abs(look(page) - first)) > 0.01
    assert not page.locator("#shape img").is_visible()
    assert said == []
    page.close()


@pytest.mark.browser
def test_the_words_at_the_shape_follow_the_reader_from_light_to_dark(
    browser: Browser, report: Written
) -> None:
    page, _, _ = opened(browser, report, 1280, "light")
    look(page)
    ink = "getComputedStyle(document.documentElement).getPropertyValue('--ink').trim()"
    light = page.evaluate(ink)
    assert page.evaluate("document.getElementById('shape-scene').layout.font.color") == light
    page.emulate_media(color_scheme="dark")
    page.wait_for_function(f"document.getElementById('shape-scene').layout.font.color == {ink}")
    assert page.evaluate(ink) != light
    page.close()


@pytest.mark.browser
def test_without_webgl_the_picture_of_the_shape_stays(
    flat_browser: Browser, report: Written
) -> None:
    page, said, _ = opened(flat_browser, report, 1280, "light")
    assert page.locator("#shape img").is_visible()
    assert not page.locator("#shape-mode").is_visible()
    assert said == []
    page.close()
