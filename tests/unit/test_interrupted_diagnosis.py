"""A diagnosis that is killed goes on where it stopped, and says the same as one that was not."""

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from femnl.diagnose import diagnose, record
from femnl.effects import library
from femnl.io import measurement

ORDERS = np.array([(1, 1), (1, 2), (2, 1), (2, 2), (1, 3), (3, 1), (2, 3), (3, 2)])
TORN = '["torn", [1.0, 2'
STRESS = 1 + 1e-3 * np.array([1, -1])
FEW = ("aspect_ratio", "compliant_clamp", "shear_stress", "stress_anisotropy")
DIAGNOSE = (
    "from femnl.diagnose import diagnose; from femnl.effects import library; "
    "diagnose({path!r}, effects=[library()[name] for name in {few}])"
)


@pytest.mark.slow
def test_a_killed_diagnosis_goes_on_where_it_stopped_and_says_the_same(
    tmp_path: Path, own_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "split.nc"
    rng = np.random.default_rng(3)
    frequency = 1.11e6 * np.sqrt(ORDERS**2 @ STRESS)
    data = measurement.spectrum(
        frequency + 3 * rng.standard_normal(8), np.full(8, 3.0), [f"{m},{n}" for m, n in ORDERS]
    )
    measurement.write(measurement.bundle({"spectrum": data}, geometry="square-270um"), path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(own_cache))
    folder = own_cache / "femnl"
    kept = lines_of_killed(path, folder, 5)
    (checkpoint,) = folder.glob("diagnosis-*.jsonl")
    with checkpoint.open("a", encoding="utf-8") as file:
        file.write(TORN)
    later = lines_of_killed(path, folder, len(kept) + 6)
    assert later[: len(kept)] == kept, "a kept line was changed, or the torn one spoils another"
    made = [json.loads(line)[0] for line in later]
    assert len(set(made)) == len(made) >= len(kept) + 4, "a fit that was kept was made again"
    effects = [library()[name] for name in FEW]
    again = diagnose(path, effects=effects)
    assert not list(folder.glob("diagnosis-*.jsonl"))
    assert record(again) == record(diagnose(path, effects=effects))


def lines_of_killed(path: Path, folder: Path, count: int) -> list[str]:
    """Kill a diagnosis once its checkpoint has so many lines, and return those that are whole."""
    program = DIAGNOSE.format(path=str(path), few=FEW)
    run = subprocess.Popen([sys.executable, "-c", program])
    deadline = time.monotonic() + 120
    lines = list[str]()
    while run.poll() is None and time.monotonic() < deadline:
        for checkpoint in folder.glob("diagnosis-*.jsonl"):
            lines = checkpoint.read_text(encoding="utf-8").splitlines(keepends=True)
        if len(lines) >= count:
            run.kill()
        time.sleep(0.002)
    assert run.wait() == -9, "it ended before it could be killed"
    (checkpoint,) = folder.glob("diagnosis-*.jsonl")
    return [
        line
        for line in checkpoint.read_text(encoding="utf-8").splitlines(keepends=True)
        if line.endswith("\n")
    ]
