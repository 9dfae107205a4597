"""Diagnose sweeps, a spectrum, a trace and a map by this code and by an earlier one, in turn.

Run `python -m benchmarks.diagnosis_before [FOLDER [REVISION]]`; it writes diagnosis_before.csv.
The earlier code is a revision of the repository, checked out beside this one. Files are those of
the virtual laboratory, with one cause each, which the library has or lacks. Seconds are those that
a user waits, all imports included, and two processes fit; each file is diagnosed REPEATS times by
either code, and the fastest counts.
"""

import csv
import json
import os
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace

from tests.blind.lab import KINDS, Case, make, maps

ROOT = Path(__file__).parent.parent
EARLIER = "23576ef"
"""The last revision before fits were made faster."""
REPEATS = 2
WIDE = "map of 101 × 101"
FILES = (
    ("response", "crosstalk"),
    ("response", "unsettled_mode"),
    ("spectrum", "compliant_clamp"),
    ("trace", "multilayer_fringe"),
    (WIDE, "detector_saturation"),
)
SEED = 5


def diagnosed(tree: Path, path: Path, gone: str | None) -> dict[str, str | float]:
    """Return the verdict of the code in a folder, its seconds and its peak memory [MiB]."""
    script = [str(ROOT / "benchmarks" / "diagnosis_once.py"), str(path)]
    command = [sys.executable, *script, *([gone] if gone else [])]
    runs = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        done = subprocess.run(
            command,
            env=os.environ | {"PYTHONPATH": str(tree)},
            check=True,
            capture_output=True,
            text=True,
        )
        runs.append(json.loads(done.stdout) | {"seconds": time.perf_counter() - start})
    # The first run may have had modes to solve
    least = {name: min(run[name] for run in runs) for name in ("seconds", "memory")}
    return {"verdict": runs[0]["verdict"]} | least


def main(folder: Path, revision: str = EARLIER) -> None:
    """Time every file with its cause in the library and without it, by either code."""
    KINDS[WIDE] = SimpleNamespace(setup=partial(maps.MapBench, points=101), CAUSES=maps.CAUSES)
    rows = []
    with tempfile.TemporaryDirectory() as room:
        earlier = Path(room) / "earlier"
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "--detach", str(earlier), revision], check=True)
        try:
            for kind, cause in FILES:
                path = Path(room) / "file.nc"
                make(Case(kind, (cause,), SEED), path)
                for gone in (None, cause):
                    old = diagnosed(earlier, path, gone)
                    new = diagnosed(ROOT, path, gone)
                    rows.append(
                        [
                            kind,
                            cause,
                            "no" if gone else "yes",
                            old["verdict"],
                            new["verdict"],
                            old["seconds"],
                            new["seconds"],
                            float(old["seconds"]) / float(new["seconds"]),
                            old["memory"],
                            new["memory"],
                        ]
                    )
        finally:
            subprocess.run([*git, "remove", "--force", str(earlier)], check=True)
    with (folder / "diagnosis_before.csv").open("w", newline="", encoding="utf-8") as file:
        head = [
            "data",
            "cause in them",
            "in the library",
            "verdict before",
            "verdict now",
            "before (s)",
            "now (s)",
            "ratio",
            "memory before (MiB)",
            "memory now (MiB)",
        ]
        csv.writer(file).writerows([head, *rows])


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(), *sys.argv[2:3])
