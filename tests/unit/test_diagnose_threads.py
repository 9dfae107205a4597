"""How many threads a diagnosis takes."""

from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_info, threadpool_limits

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import Lines
from femnl.diagnose import diagnose
from femnl.io import measurement


def _threads() -> set[int]:
    return {int(pool["num_threads"]) for pool in threadpool_info() if pool["user_api"] == "blas"}


def test_linear_algebra_takes_one_thread_while_causes_are_sought_and_as_many_as_before_thereafter(
    tmp_path: Path,
) -> None:
    seen: list[set[int]] = []

    def spy(lines: Lines, values: Values) -> Lines:
        seen.append(_threads())
        return lines

    effect = Effect(
        "spy", "", (ParameterSpec("strength", "1", 0.0, 1.0),), {"frequencies": spy}, "", "", ""
    )
    data = measurement.spectrum(1e6 * np.arange(1, 6) + 0.0, np.full(5, 10.0))
    measurement.write(
        measurement.bundle({"spectrum": data}, geometry="square-270um"), tmp_path / "a.nc"
    )
    diagnose(tmp_path / "a.nc", effects=[effect])  # loads what it needs
    with threadpool_limits(3, user_api="blas"):
        before = _threads()
        diagnose(tmp_path / "a.nc", effects=[effect])
        assert _threads() == before
    assert 3 in before
    assert seen
    assert all(threads == {1} for threads in seen)
