"""Mutated geometry and measurement files give a device, data, or one line.

Found by coverage; never a traceback or a hang.
"""

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from femnl.core import resources
from femnl.io import measurement

SECONDS = 200  # for each reader: ten minutes together
# Seconds that one file may take: a damaged text may claim 4 GiB, which HDF5 clears before it looks
SLOWEST = 90
MEBIBYTES = 6144  # of memory


def seeds(target: str, folder: Path) -> None:
    """Put good files into a folder, from which the fuzzer starts."""
    folder.mkdir()
    if target == "geometry":
        for path in resources.geometries().glob("*.toml"):
            shutil.copy(path, folder)
    elif target == "measurement":
        frequency = np.linspace(1e6, 1.1e6, 12)
        response = measurement.response(
            frequency[None], (1 / (frequency - 1.05e6 + 1e4j))[None], drive=[1.0], direction=[1]
        )
        measurement.write(
            measurement.bundle({"sweep": response}, geometry="circle"), folder / "response.nc"
        )
    else:
        (folder / "bytes").write_bytes(np.random.default_rng(1).bytes(3000))


@pytest.mark.slow
@pytest.mark.parametrize("target", ["geometry", "measurement", "structure"])
def test_a_fuzzed_file_is_read_or_refused(target: str, tmp_path: Path) -> None:
    if importlib.util.find_spec("atheris") is None:
        pytest.skip("atheris is not installed")
    seeds(target, tmp_path / "seeds")
    flags = [
        f"-max_total_time={SECONDS}",
        f"-timeout={SLOWEST}",
        f"-rss_limit_mb={MEBIBYTES}",
        "-max_len=65536",
        "-seed=1",
    ]
    command = [
        sys.executable,
        str(Path(__file__).with_name("fuzz.py")),
        target,
        str(tmp_path / "seeds"),
        *flags,
    ]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode(errors="replace")[-4000:]
