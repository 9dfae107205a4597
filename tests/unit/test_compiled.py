"""Machine code."""

import numpy as np
import pytest

from femnl.core.compiled import compiled


def test_where_nothing_can_be_written_machine_code_is_made_anew(
    caplog: pytest.LogCaptureFixture,
) -> None:
    space: dict[str, object] = {}
    # Beside which nothing can be kept
    exec(compile("def double(x):\n    x *= 2\n", "<no file>", "exec"), space)
    double = space["double"]
    assert callable(double)
    x = np.ones(3)
    compiled(double)(x)
    assert (x == 2).all()
    assert "anew in every run" in caplog.text
