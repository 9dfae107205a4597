"""Output that goes nowhere, and terminals of other encodings: processes that a shell starts."""

import sys
from pathlib import Path

import numpy as np

from tests.robust.hostile.files import drum, measurement, pick, resonance

ENVIRONMENTS = [
    "LC_ALL=C PYTHONCOERCECLOCALE=0 PYTHONUTF8=0",
    "PYTHONIOENCODING=ascii",
    "PYTHONIOENCODING=latin-1",
    "LC_ALL=POSIX PYTHONUTF8=0",
    "COLUMNS=1",
    "COLUMNS=0 LINES=0",
    "TERM=dumb NO_COLOR=1",
    "HOME=/nowhere XDG_CACHE_HOME=/nowhere",
    "XDG_CACHE_HOME=/dev/null",
    "TMPDIR=/nowhere",
    "PYTHONWARNINGS=default",
    "TERM= LANG=",
    "",
]
ENDS = [
    "",
    ">&-",
    "2>&-",
    ">&- 2>&-",
    "<&-",
    "| head -c 20",
    "| true",
    "> /dev/full",
    "2> /dev/full",
]


def make(rng: np.random.Generator, folder: Path) -> list[str]:
    """Run a command in an odd environment or with an odd end."""
    frequency, volts = resonance(rng)
    data = {"frequency": frequency[None], "real": volts.real[None], "imag": volts.imag[None]}
    measurement(folder / "f.nc", "response", data, {"noise_sd": 1e-6}, {"title": "µ ± Δ 漢"})
    drum(folder)
    command = pick(
        rng,
        [
            "geometries",
            "effects",
            "effects duffing",
            "modes drum.toml -n 2 --resolution 0.3",
            "modes drum.toml -n 2 --resolution 0.3 --json",
            "modes drum.toml -n 2 --resolution 0.3 --format latex",
            "show f.nc",
            "show f.nc --out o",
            "fit f.nc",
            "fit f.nc --json",
            "modes nowhere",
            "--help",
            "fit --help",
            "--version",
            "fit µ.nc",
            "mesh drum.toml --resolution 0.3 --format csv",
        ],
    )
    way = rng.random()
    environment = pick(rng, ENVIRONMENTS) if way < 0.6 else ""
    end = pick(rng, ENDS) if way > 0.4 else ""
    return ["!", f"{environment} {sys.executable} -m femnl {command} {end}"]
