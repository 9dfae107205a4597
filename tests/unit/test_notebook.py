"""What a notebook shows: one line of words that fits a line, a picture, and a table."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from femnl.core.device import Model
from femnl.core.fit import Fit, Parameter
from femnl.core.modes import Modes
from femnl.core.readout import HarmonicMap
from femnl.device import geometry
from femnl.pipeline import harmonic_maps, solve_modes
from femnl.plot.notebook import bundle, picture

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def modes(device: Callable[..., Model]) -> Modes:
    """Two modes of a square of 100 µm whose waves run at √(1e9/3000) m/s."""
    return solve_modes(device('kind = "square"\nside = "100 um"'), 2, cache=False)


@pytest.fixture(scope="module")
def maps(modes: Modes) -> HarmonicMap:
    """Two harmonics of a displacement squared and plain."""
    return harmonic_maps(modes, 0, lambda u: u**2 + u, 1e-7, 633e-9, harmonics=2, points=21)


def test_words_say_what_it_is_in_one_line(modes: Modes, maps: HarmonicMap) -> None:
    assert repr(geometry.load("square-270um-perforated")) == (
        "<Model square-270um-perforated: square of 270 µm, 900 holes, film 183.75 nm at 1101.5 MPa>"
    )
    low = np.sqrt(1e9 / 3000) / np.sqrt(2) / 100e-6
    assert (
        repr(modes)
        == f"<Modes of device: 2, from {low:.7g} Hz to {low * 2.5**0.5:.7g} Hz, degree 4>"
    )
    assert repr(modes.domain).startswith("<Domain of device: ")
    assert repr(maps) == "<HarmonicMap of 1f, 2f: 21 × 21 points at 633 nm>"
    fit = Fit(
        {"f": Parameter("f", 1e6, 0.25, "Hz"), "Q": Parameter("Q", 2.0, 1.0, "")},
        np.eye(2),
        1.05,
        40,
        2,
    )
    assert repr(fit) == "<Fit: f = 1000000 ± 0.25 Hz, Q = 2 ± 1; χ²/ν = 1.05 of 40 numbers>"


def test_device_modes_and_maps_have_pictures(modes: Modes, maps: HarmonicMap) -> None:
    for value in (modes.domain.model, modes, maps):
        content = picture(value)
        assert content.startswith(b"\x89PNG")
        assert len(content) > 5000


def test_a_notebook_shows_the_picture_without_being_asked(tmp_path: Path) -> None:
    pytest.importorskip("IPython")
    program = (
        "from IPython.core.interactiveshell import InteractiveShell\nshell = "
        "InteractiveShell.instance()\n"
        "shell.run_cell('import femnl')\nshell.run_cell('model = femnl.load(\"circle\")')\n"
        "data, _ = shell.display_formatter.format(shell.user_ns['model'])\nprint(sorted(data), "
        "data['text/plain'])"
    )
    command = [sys.executable, "-c", program]
    environment = {
        "PYTHONPATH": str(ROOT),
        "HOME": str(tmp_path),
        "IPYTHONDIR": str(tmp_path),
        "PATH": "/usr/bin",
    }
    done = subprocess.run(
        command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1].startswith(
        "['image/png', 'text/plain'] <Model circle: circle of 270 µm, no holes"
    )


def test_a_notebook_keeps_the_picture_beside_the_table(modes: Modes) -> None:
    shown = bundle(modes)
    assert set(shown) == {"image/png", "text/html"}
    text = shown["text/html"]
    assert isinstance(text, str)
    assert text.startswith(modes._repr_html_())
    assert 'src="data:image/png;base64,iVBOR' in text


@pytest.mark.parametrize(
    ("types", "shown"),
    [
        (["text/plain", "text/html", "image/png"], ["image/png", "text/html", "text/plain"]),
        (["text/plain"], ["text/plain"]),
    ],
)
def test_a_notebook_shows_both_and_a_terminal_draws_nothing(
    types: list[str], shown: list[str], tmp_path: Path
) -> None:
    pytest.importorskip("IPython")
    program = f"""
from IPython.core.interactiveshell import InteractiveShell
import numpy as np
shell = InteractiveShell.instance()
shell.display_formatter.active_types = {types}
import femnl
from femnl.core.readout import HarmonicMap
axis = np.linspace(-1e-4, 1e-4, 5)
maps = HarmonicMap(axis, axis, np.array([1]), np.ones((1, 5, 5)) + 0j, 633e-9)
print(sorted(shell.display_formatter.format(maps)[0]))
"""
    home = {"HOME": str(tmp_path), "IPYTHONDIR": str(tmp_path), "MPLCONFIGDIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={"PYTHONPATH": str(ROOT), "PATH": "/usr/bin"} | home,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.splitlines()[-1] == str(shown), done.stderr
