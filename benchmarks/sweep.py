"""A sweep of tiny films on one and on two workers.

What femnl adds to a point, and what a second worker gains.

Run `python -m benchmarks.sweep [FOLDER]`; it writes sweep.csv. Overhead is what one worker's time
beyond the points themselves is of them: starting the worker apart, which is paid once. The client's
own processor time a point, which other programs hardly change, is given beside it. Gains are of
points a second between the first and the last record of a run.
"""

import csv
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from femnl.sweep import engine, open_store, read_sweep, run
from femnl.sweep.point import Point, Record, Settings
from femnl.sweep.solve import attempt

POINTS = 24
GEOMETRY = """
name = "film"
source = "a benchmark"
[outline]
kind = "square"
side = "100 um"
[film]
thickness = "100 nm"
young = "250 GPa"
poisson = 0.23
density = "3000 kg/m^3"
stress = "1 GPa"
"""
SPEC = f"""
geometry = "film.toml"
modes = 6
[[axis]]
film.stress = {{from = "0.8 GPa", to = "1.2 GPa", points = {POINTS}}}
"""


def in_process(points: Iterator[Point], settings: Settings) -> Iterator[Record]:
    """Solve here, without workers and without a store."""
    for point in points:
        yield attempt(point, settings)


def timed(
    name: str, solve: Callable[[Iterator[Point], Settings], Iterator[Record]], folder: Path
) -> dict[str, float | str]:
    """Run the whole sweep and return its seconds and those that its points took."""
    sweep = read_sweep(folder / "sweep.toml")
    stamps: list[tuple[float, float, float]] = []
    load = os.getloadavg()[0]
    begun = time.perf_counter()
    with open_store(folder / f"{name}.jsonl", sweep.settings, None, False) as store:
        run(
            sweep,
            store,
            solve,
            lambda record: stamps.append(
                (time.perf_counter(), time.process_time(), record["seconds"])
            ),
        )
    (first, own, _), *rest = stamps
    return {
        "engine": name,
        "points": POINTS,
        "start (s)": first - begun,
        "steady (s)": stamps[-1][0] - first,
        "in points (s)": sum(seconds for *_, seconds in rest),
        "points per second": len(rest) / (stamps[-1][0] - first),
        "client CPU (s)": (stamps[-1][1] - own) / len(rest),
        "bytes a point": len(json.dumps(list(store.records.values()), ensure_ascii=False).encode())
        / POINTS,
        "load before": load,
    }


def main(folder: Path) -> None:
    """Measure and print; figures of a busy machine are worth less, as its load says."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        (place / "film.toml").write_text(GEOMETRY, encoding="utf-8")
        (place / "sweep.toml").write_text(SPEC, encoding="utf-8")
        engines = {
            "none": in_process,
            "processes-1": engine(None, 1),
            "processes-2": engine(None, 2),
        }
        engines |= {"dask-1": engine("local", 1), "dask-2": engine("local", 2)}
        rows = [timed(name, solve, place) for name, solve in engines.items()]
    with (folder / "sweep.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    sys.stdout.write("".join(f"{name:>18}" for name in rows[0]) + "\n")
    for row in rows:
        sys.stdout.write(
            "".join(f"{v:>18}" if isinstance(v, str) else f"{v:18.3f}" for v in row.values()) + "\n"
        )
    by = {row["engine"]: row for row in rows}
    for kind in ("processes", "dask"):
        one = by[f"{kind}-1"]
        two = by[f"{kind}-2"]
        overhead = float(one["steady (s)"]) / float(one["in points (s)"]) - 1
        gain = float(two["points per second"]) / float(one["points per second"])
        busy = float(two["in points (s)"]) / float(two["steady (s)"])
        sys.stdout.write(
            f"{kind}: overhead {overhead:.1%} a point on one worker, "
            f"{1e3 * float(one['client CPU (s)']):.1f} ms of the client's processor;"
            f" two workers do {gain:.2f} times as many points a second, with {busy:.2f} points "
            "under way\n"
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path())
