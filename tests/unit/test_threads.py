"""Linear algebra of a solution takes one thread, whatever the machine offers."""

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from femnl import load, solve_modes
from femnl.core.modes import Modes
from femnl.core.processes import one_blas_thread
from femnl.mechanics.modes import counterparts


def blas_threads() -> int:
    """Return the most threads that a library of linear algebra would take here."""
    libraries = [one for one in threadpool_info() if one["user_api"] == "blas"]
    return max(int(library["num_threads"]) for library in libraries)


def test_modes_are_solved_with_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: set[int] = set()
    align = counterparts.align

    def watched(coarse: Modes, fine: Modes) -> Modes:
        seen.add(blas_threads())
        return align(coarse, fine)

    monkeypatch.setattr(counterparts, "align", watched)
    with threadpool_limits(2, user_api="blas"):
        assert blas_threads() == 2
        solve_modes(load("circle"), 1, resolution=0.5, cache=False)
        assert blas_threads() == 2
    assert seen == {1}


def test_threads_are_given_back() -> None:
    np.linalg.norm(np.ones(2))
    with threadpool_limits(2, user_api="blas"):
        with pytest.raises(ValueError, match="stop"), one_blas_thread():
            raise ValueError("stop")
        assert blas_threads() == 2
