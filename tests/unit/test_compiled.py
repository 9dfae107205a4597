"""Machine code."""

import numpy as np
import pytest
from numba.core.caching import CacheImpl

from femnl.compiled import compiled


def _double(x: np.ndarray) -> None:
    x *= 2


def test_where_nothing_can_be_written_machine_code_is_made_anew(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    monkeypatch.setattr(CacheImpl, "_locator_classes", [])
    x = np.ones(3)
    compiled(_double)(x)
    assert (x == 2).all()
    assert "anew in every run" in caplog.text
