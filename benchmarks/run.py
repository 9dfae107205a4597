"""Run the benchmarks of this folder, each in its own process, and keep their results.

Run `python benchmarks/run.py [NAME …]` (all where none is named); it writes build/benchmarks/NAME/
and brings validation/benchmarks.json, which `femnl report` shows, up to date for those that were
run and did not fail.

A benchmark is a module NAME.py here with a `main` that `python -m benchmarks.NAME FOLDER` runs. The
first line of its docstring is the caption. Each NAME*.csv that it leaves in FOLDER is a table:
first its columns with their units, then its rows; empty or `nan` where there is nothing. What has
more than 30 rows is data for a figure and is not kept, nor is a benchmark without tables. Modules
without a `main` help the others.
"""

import csv
import json
import math
import os
import platform
import resource
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
KEPT = HERE.parent / "validation" / "benchmarks.json"
LONGEST = 30
DIGITS = 4


def names() -> list[str]:
    """Return the modules that have a `main` for the command line."""
    modules = [path for path in sorted(HERE.glob("*.py")) if path.name != Path(__file__).name]
    return [path.stem for path in modules if '__name__ == "__main__"' in path.read_text("utf-8")]


def machine() -> dict[str, str]:
    """Describe what the benchmarks run on."""
    information = Path("/proc/cpuinfo")
    lines = information.read_text("utf-8").splitlines() if information.exists() else []
    model = next(
        (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")),
        platform.machine(),
    )
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    threads = os.environ.get("OMP_NUM_THREADS", "not limited")
    return {
        "processor": f"{model}, {os.cpu_count()} of them, {memory:.0f} GiB of memory",
        "system": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "threads": f"BLAS threads a process: {threads}",
    }


def run(name: str, folder: Path) -> dict[str, Any] | None:
    """Run one benchmark and return what it found; None where it fails."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob(f"{name}*.csv"):
        old.unlink()
    load = os.getloadavg()[0]
    begun = time.perf_counter()
    used = _cpu()
    command = ["python", "-m", f"{HERE.name}.{name}"]
    if subprocess.run(
        [sys.executable, *command[1:], str(folder)], cwd=HERE.parent, check=False
    ).returncode:
        return None
    return {
        "caption": _caption(name),
        "command": " ".join(command),
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
        "seconds": round(time.perf_counter() - begun, 1),
        "cpu_seconds": round(_cpu() - used, 1),
        "load_before": round(load, 2),
        **machine(),
        "tables": [
            table
            for path in sorted(folder.glob(f"{name}*.csv"))
            if (table := _table(path)) is not None
        ],
    }


def _cpu() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _caption(name: str) -> str:
    return (HERE / f"{name}.py").read_text("utf-8").split('"""')[1].splitlines()[0]


def _table(path: Path) -> dict[str, list[Any]] | None:
    with path.open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    return (
        {"head": head, "rows": [[_cell(text) for text in row] for row in rows]}
        if len(rows) <= LONGEST
        else None
    )


def _cell(text: str) -> str | float | None:
    """A number to few digits, nothing for nan, or else the text."""
    try:
        value = float(text)
    except ValueError:
        return text or None
    return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None


def main() -> int:
    """Run the named benchmarks, or all; return the number of those that failed."""
    chosen = sys.argv[1:] or names()
    unknown = sorted(set(chosen) - set(names()))
    if unknown:
        sys.exit(f"benchmarks: no {unknown[0]} here; there are {', '.join(names())}")
    failed = 0
    for name in chosen:
        sys.stdout.write(f"== {name}\n")
        sys.stdout.flush()
        result = run(name, HERE.parent / "build" / "benchmarks" / name)
        failed += result is None
        if result is not None and result["tables"]:
            known = json.loads(KEPT.read_text("utf-8")) if KEPT.exists() else {}
            KEPT.write_text(
                json.dumps(
                    dict(sorted((known | {name: result}).items())), indent=1, ensure_ascii=False
                )
                + "\n",
                "utf-8",
            )
    return failed


if __name__ == "__main__":
    sys.exit(main())
