"""Seconds from the command to its answer: help, lists, refusals, and modes that were kept.

Run `python -m benchmarks.startup [FOLDER]`; it writes startup.csv. Every command runs ROUNDS times,
in turn with the others, so that what else the machine does meets all alike; the fastest counts, as
it is the least disturbed. Ratios are to `python -c "import typer"`, the least that any command of
this kind takes. Kept modes have a cache of their own, filled before the clock runs.
"""

import csv
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROUNDS = 7
FEMNL = [sys.executable, "-m", "femnl"]
COMMANDS: dict[str, list[str]] = {
    "import typer": [sys.executable, "-c", "import typer"],
    "femnl --help": [*FEMNL, "--help"],
    "femnl modes --help": [*FEMNL, "modes", "--help"],
    "femnl fit --help": [*FEMNL, "fit", "--help"],
    "femnl diagnose --help": [*FEMNL, "diagnose", "--help"],
    "femnl geometries": [*FEMNL, "geometries"],
    "femnl modes squar (refused)": [*FEMNL, "modes", "squar"],
    "femnl fit missing.nc (refused)": [*FEMNL, "fit", "missing.nc"],
    "femnl modes square-270um (kept)": [*FEMNL, "modes", "square-270um"],
}


def seconds(command: list[str], cache: Path) -> float:
    """Run one command, whose output is of no interest here, and return its seconds."""
    environment = os.environ | {"XDG_CACHE_HOME": str(cache)}
    begun = time.perf_counter()
    subprocess.run(
        command,
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        check=False,
    )
    return time.perf_counter() - begun


def main(folder: Path) -> None:
    """Time every command and write the table."""
    with tempfile.TemporaryDirectory() as name:
        cache = Path(name)
        for command in COMMANDS.values():
            seconds(command, cache)
        taken: dict[str, list[float]] = {name: [] for name in COMMANDS}
        for _ in range(ROUNDS):
            for name, command in COMMANDS.items():
                taken[name].append(seconds(command, cache))
    least = min(taken["import typer"])
    with (folder / "startup.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["command", "fastest [s]", "ratio to import typer"])
        for name, times in taken.items():
            table.writerow([name, f"{min(times):.3f}", f"{min(times) / least:.2f}"])


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path())
