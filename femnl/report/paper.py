"""The page on paper: a PDF, printed by a browser of the system."""

import os
import shutil
import subprocess
from pathlib import Path

from femnl.core.errors import MissingLibraryError, ParameterError
from femnl.io.results.atomic import write_whole

BROWSERS = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "microsoft-edge",
)
SECONDS = 300


def find_browser() -> str:
    """Return the path of a browser that prints without a window.

    Raises: MissingLibraryError where there is none.
    """
    for name in BROWSERS:
        path = shutil.which(name)
        if path is not None:
            return path
    raise MissingLibraryError(
        "a PDF is printed by Chromium or Chrome, and none is on the PATH; install one, or print "
        "the page from a browser"
    )


def print_page(page: Path, browser: str) -> Path:
    """Print a page to a PDF beside it, whole or not at all. Returns: its path.

    Raises: ParameterError where the browser fails.
    """
    path = page.with_suffix(".pdf")
    switches = [
        "--headless",
        "--no-pdf-header-footer",
        "--disable-gpu",
        "--disable-background-networking",
        "--no-first-run",
    ]
    if os.geteuid() == 0:
        switches.append("--no-sandbox")  # which Chromium refuses to set up for root

    def write(file: Path) -> None:
        command = [browser, *switches, f"--print-to-pdf={file}", page.resolve().as_uri()]
        try:
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                errors="replace",
                timeout=SECONDS,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise ParameterError(
                f"{path}: {browser} did not print it in {SECONDS} s; print {page} from a browser"
            ) from None
        printed = file.is_file() and file.read_bytes().startswith(b"%PDF")
        if done.returncode or not printed:
            raise ParameterError(
                f"{path}: {browser} did not print it (status {done.returncode}); print {page} "
                "from a browser"
            )

    write_whole(path, write)
    return path
