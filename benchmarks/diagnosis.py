"""Diagnose eight sweeps, a spectrum and a map of 6 × 101 × 101 values on one and on two workers.

Run `python -m benchmarks.diagnosis [FOLDER]`; it writes diagnosis.csv. Files are those of the
virtual laboratory, with one cause each, which the library has or lacks; where it lacks it, sets of
three causes are tried, too. The film's modes are solved beforehand.
"""

import csv
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace

from femnl.diagnose import diagnose, record
from femnl.effects import library
from tests.blind.lab import KINDS, Case, make, maps

WIDE = "map of 101 × 101"
FILES = (
    ("response", "nonlinear_damping"),
    ("response", "crosstalk"),
    ("spectrum", "added_mass"),
    ("spectrum", "compliant_clamp"),
    (WIDE, "phase_tilt"),
    (WIDE, "detector_saturation"),
)
SEED = 5


def timed(path: Path, gone: str | None, workers: int) -> tuple[float, dict[str, object]]:
    """Diagnose a file without one of the effects; seconds, and what is found."""
    effects = [effect for name, effect in library().items() if name != gone]
    begun = time.perf_counter()
    found = record(diagnose(path, effects=effects, workers=workers))
    return time.perf_counter() - begun, found


def main(folder: Path) -> None:
    """Time every file with its cause in the library and without it."""
    KINDS[WIDE] = SimpleNamespace(setup=partial(maps.MapBench, points=101), CAUSES=maps.CAUSES)
    rows = []
    with tempfile.TemporaryDirectory() as room:
        for kind, cause in FILES:
            path = Path(room) / "file.nc"
            make(Case(kind, (cause,), SEED), path)
            diagnose(path, effects=[])
            for gone in (None, cause):
                alone, one = timed(path, gone, 1)
                beside, two = timed(path, gone, 2)
                if one != two:
                    raise SystemExit(f"{kind} {cause}: two workers find another diagnosis than one")
                rows.append(
                    [
                        kind,
                        cause,
                        "no" if gone else "yes",
                        one["verdict"],
                        alone,
                        beside,
                        alone / beside,
                    ]
                )
    with (folder / "diagnosis.csv").open("w", newline="", encoding="utf-8") as file:
        head = [
            "data",
            "cause in them",
            "in the library",
            "verdict",
            "one worker (s)",
            "two workers (s)",
            "gain of the second",
        ]
        csv.writer(file).writerows([head, *rows])


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path())
