"""Ten modes of the perforated 30 × 30 device with bending, k₃, α and error estimates: time of the command and of its stages.

Run `python -m benchmarks.perforated [FOLDER]`; it writes perforated.csv.
"""

import csv
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TypeVar

from femnl.geometry import load
from femnl.mesh import mesh
from femnl.modes import align, solve_modes
from femnl.nonlinearity import solve_nonlinearity
from femnl.predict import DEGREE
from femnl.prestress import solve_prestress
from femnl.types.mechanics import Modes

T = TypeVar("T")
DEVICE, COUNT = "square-270um-perforated", 10


def timed(name: str, rows: list[tuple[str, float]], stage: Callable[[], T]) -> T:
    """Run a stage and note its wall time."""
    start = time.perf_counter()
    result = stage()
    rows.append((name, time.perf_counter() - start))
    return result


def main(folder: Path) -> None:
    """Time the stages in this process, then the command in one of its own."""
    rows: list[tuple[str, float]] = []
    model = load(DEVICE)
    domain = timed("mesh", rows, partial(mesh, model))
    solved: dict[int, Modes] = {}
    for degree in (DEGREE, DEGREE - 1):
        prestress = timed(f"prestress, degree {degree}", rows, partial(solve_prestress, domain, degree))
        solved[degree] = timed(f"modes, degree {degree}", rows, partial(solve_modes, prestress, COUNT, degree))
    coarse = timed("counterparts of lower degree", rows, partial(align, solved[DEGREE - 1], solved[DEGREE]))
    for modes in (solved[DEGREE], coarse):
        timed(f"nonlinearity, degree {modes.degree}", rows, partial(solve_nonlinearity, modes, "clamped"))
    command = [sys.executable, "-c", "from femnl.cli import main; main()", "modes", DEVICE, "--count", str(COUNT), "--no-cache", "--json"]
    timed("the whole command", rows, partial(subprocess.run, command, check=True, stdout=subprocess.DEVNULL))
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    with (folder / "perforated.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([("stage", "seconds"), *rows, ("peak memory of the command, MiB", peak)])
    unknowns = solved[DEGREE].shapes.shape[1]
    sys.stdout.write(f"{DEVICE}: {domain.mesh.nelements} triangles and {unknowns} unknowns of w in a {domain.copies}th of the film\n")
    sys.stdout.writelines(f"{name:32} {seconds:7.1f} s\n" for name, seconds in rows)
    sys.stdout.write(f"{'peak memory of the command':32} {peak:7.0f} MiB\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path())
