"""What the tests of the report share: one report."""

import pytest

from tests.unit.report_page import Written, make_report


@pytest.fixture(scope="session")
def report(tmp_path_factory: pytest.TempPathFactory) -> Written:
    """A report on one small device."""
    return make_report(tmp_path_factory.mktemp("report"))
