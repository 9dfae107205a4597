"""A diagnosis that is killed goes on where it stopped, and says the same as one that was not."""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from platformdirs import user_cache_path

from femnl import measurement
from femnl.diagnose import diagnose, fit, record
from femnl.diagnose.problem import Extended
from femnl.types.readout import Array

ORDERS = np.array([(1, 1), (1, 2), (2, 1), (2, 2), (1, 3), (3, 1), (2, 3), (3, 2)])
STRESS = 1 + 1e-3 * np.array([1, -1])


def test_a_killed_diagnosis_goes_on_where_it_stopped_and_says_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "split.nc"
    rng = np.random.default_rng(3)
    frequency = 1.11e6 * np.sqrt(ORDERS**2 @ STRESS)
    data = measurement.spectrum(frequency + 3 * rng.standard_normal(8), np.full(8, 3.0), [f"{m},{n}" for m, n in ORDERS])
    measurement.write(measurement.bundle({"spectrum": data}, geometry="square-270um"), path)
    folder = tmp_path / "cache" / "femnl"
    folder.mkdir(parents=True)
    for solved in user_cache_path("femnl").glob("*.n[cp]*"):
        (folder / solved.name).symlink_to(solved)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    run = subprocess.Popen([sys.executable, "-c", f"from femnl.diagnose import diagnose; diagnose({str(path)!r})"])
    deadline = time.monotonic() + 120
    while run.poll() is None and time.monotonic() < deadline:
        ledgers = list(folder.glob("diagnosis-*.jsonl"))
        if ledgers and len(ledgers[0].read_text(encoding="utf-8").splitlines()) >= 5:
            run.kill()
        time.sleep(0.002)
    assert run.wait() == -9, "it ended before it could be killed"
    (ledger,) = folder.glob("diagnosis-*.jsonl")
    with ledger.open("a", encoding="utf-8") as file:
        file.write('["torn", [1.0, 2')
    kept = len(ledger.read_text(encoding="utf-8").splitlines()) - 1
    made: list[int] = []
    minimise = fit._minimise

    def counted(model: Extended, start: Array, keep: NDArray[np.bool_] | None, most: int) -> tuple[Array, Array]:
        made.append(most)
        return minimise(model, start, keep, most)

    monkeypatch.setattr(fit, "_minimise", counted)
    again = diagnose(path)
    assert not list(folder.glob("diagnosis-*.jsonl"))
    left = len(made)
    assert record(again) == record(diagnose(path))
    assert left == len(made) - left - kept
