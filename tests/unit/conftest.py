"""What unit tests share: a report, and the effects of docs/howto/plugins.md."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.unit.plugin_page import EFFECT, forget
from tests.unit.report_page import Written, make_report


@pytest.fixture(scope="session")
def report(tmp_path_factory: pytest.TempPathFactory) -> Written:
    """A report on one small device."""
    return make_report(tmp_path_factory.mktemp("report"))


@pytest.fixture
def effects_folder(tmp_path: Path) -> Path:
    """The folder of effects of the page."""
    path = tmp_path / "our_effects"
    path.mkdir()
    (path / "softening.py").write_text(EFFECT, encoding="utf-8")
    return path


@pytest.fixture
def _own_plug_ins() -> Iterator[None]:
    """Let no other test see the plug-ins of this one."""
    yield
    forget()
    for name in [name for name in sys.modules if name.startswith(("toy_", "our_lab"))]:
        del sys.modules[name]
