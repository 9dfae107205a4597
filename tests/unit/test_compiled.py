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


def helper(x: float) -> float:
    return 3 * x


def with_helper(x: np.ndarray) -> None:
    for i in range(len(x)):
        x[i] = helper(x[i])


def test_functions_of_the_same_module_are_compiled_beside_it() -> None:
    x = np.ones(3)
    compiled(with_helper)(x)
    assert (x == 3).all()
    x = np.ones(3)
    with_helper(x)
    assert (x == 3).all()
