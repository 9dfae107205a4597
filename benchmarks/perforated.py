"""Ten modes of the perforated 30 × 30 device with bending, k₃, α and error estimates.

Time of the command and of its stages.

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

from femnl.device.geometry import load
from femnl.mechanics.lattice import solve_condensed, strain_energies, tile
from femnl.mechanics.modes import align
from femnl.mechanics.nonlinearity import solve_nonlinearity
from femnl.pipeline import DEGREE, SPARE

T = TypeVar("T")
DEVICE = "square-270um-perforated"
COUNT = 10
Rows = list[tuple[str, float, float]]


def timed(name: str, rows: Rows, stage: Callable[[], T]) -> T:
    """Run a stage and note its wall and processor time, with that of processes that it starts."""
    start = time.perf_counter()
    used = _cpu()
    result = stage()
    rows.append((name, time.perf_counter() - start, _cpu() - used))
    return result


def _cpu() -> float:
    own = resource.getrusage(resource.RUSAGE_SELF)
    others = resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime + others.ru_utime + others.ru_stime


def main(folder: Path) -> None:
    """Time the stages in this process, then the command in one of its own."""
    folder.mkdir(parents=True, exist_ok=True)
    rows: Rows = []
    model = load(DEVICE)
    tiling = timed("tiles", rows, partial(tile, model))
    energies = partial(strain_energies, edge=model.edge)
    finest = timed(
        f"stress and modes, degree {DEGREE}", rows, partial(solve_condensed, tiling, COUNT, DEGREE)
    )
    solved = [finest]
    for degree in (DEGREE - 1, DEGREE - 2):
        coarse = timed(
            f"stress and modes, degree {degree}",
            rows,
            partial(solve_condensed, tiling, COUNT + SPARE, degree),
        )
        solved.append(
            timed(f"counterparts of degree {degree}", rows, partial(align, coarse, finest))
        )
    for modes in solved:
        timed(
            f"k₃ and α, degree {modes.degree}",
            rows,
            partial(solve_nonlinearity, modes, model.edge, False, energies),
        )
    command = [
        sys.executable,
        "-c",
        "from femnl.cli import main; main()",
        "modes",
        DEVICE,
        "--count",
        str(COUNT),
        "--no-cache",
        "--json",
    ]
    timed(
        "the whole command",
        rows,
        partial(subprocess.run, command, check=True, stdout=subprocess.DEVNULL),
    )
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    with (folder / "perforated.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([("stage", "wall time (s)", "processor time (s)"), *rows])
    sys.stdout.write(
        f"{DEVICE}: {tiling.domain.mesh.nelements} triangles in {tiling.domain.copies} copies "
        "make the film\n"
    )
    sys.stdout.writelines(
        f"{name:32} {seconds:7.1f} s {used:7.1f} s CPU\n" for name, seconds, used in rows
    )
    sys.stdout.write(f"{'peak memory of the command':32} {peak:7.0f} MiB\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path())
