"""A perforated membrane by femnl and by its peers: time, peak memory and error of the ratios f/f₁, each in a process of its own.

Run `python -m benchmarks.peers [FOLDER]`; it writes peers.csv and peers.png. The device is the square of 30 × 30 holes; peers
solve it as a membrane (relaxed stress, tension, no bending, no nonlinearity), femnl so and with bending and all of α and k₃.
"""

import csv
import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import matplotlib as mpl
import numpy as np

from benchmarks.peers_ngsolve import solve as solve_with_ngsolve
from benchmarks.peers_plain import plain_scikit_fem
from femnl import load
from femnl.lattice import solve_homogenised
from femnl.predict import solve_modes, solve_nonlinearity
from femnl.types.device import Holes, Model

COUNT = 12
PITCH = 8.56e-6
FEW = 6  # ratios that are compared: doublets of all codes come in one order
GROWTH = (8, 12, 20, 30)  # holes along a side


def device(n: int = 30, bending: bool = True) -> Model:
    """The square of n × n holes with the margin of the shipped one."""
    model: Model = load("square-270um-perforated")
    side = model.outline.length + (n - 30) * PITCH
    factor = side / model.outline.length
    segments = tuple(
        replace(s, start=(s.start[0] * factor, s.start[1] * factor), end=(s.end[0] * factor, s.end[1] * factor))
        for s in model.outline.segments
    )
    outline = replace(model.outline, segments=segments, size=(side, side), length=side)
    places = PITCH * (np.arange(n) - (n - 1) / 2)
    holes = Holes(np.stack(np.meshgrid(places, places), -1).reshape(-1, 2), model.holes.radius)
    smaller: Model = replace(model, outline=outline, holes=holes, bending=bending)
    return smaller


def full(n: int, bending: bool, resolution: float) -> list[float]:
    """Modes with error bars, α and k₃ on a mesh with every hole."""
    modes = solve_modes(device(n, bending), COUNT, resolution=resolution, cache=False)
    if bending:
        solve_nonlinearity(modes, tensor=True, cache=False)
    return [float(r) for r in modes.ratio]


def homogenised(n: int, bending: bool) -> list[float]:
    """The lattice as an even film."""
    return [float(r) for r in solve_homogenised(device(n, bending), COUNT, tensor=bending)[0].ratio]


def ngsolve(n: int) -> list[float]:
    """NGSolve, cubic elements."""
    return solve_with_ngsolve(device(n, bending=False), COUNT)


RUNS: dict[str, Callable[[int], list[float]]] = {
    "femnl, all": lambda n: full(n, True, 1.0),
    "femnl, all, coarse": lambda n: full(n, True, 0.5),
    "femnl, all, homogenised": lambda n: homogenised(n, True),
    "femnl, membrane": lambda n: full(n, False, 1.0),
    "femnl, membrane, coarse": lambda n: full(n, False, 0.5),
    "femnl, membrane, homogenised": lambda n: homogenised(n, False),
    "scikit-fem and scipy, plain": lambda n: plain_scikit_fem(device(n, bending=False), COUNT),
    "NGSolve, order 3": ngsolve,
}
REFERENCE = {True: "femnl, all", False: "femnl, membrane"}


def run(name: str, n: int) -> dict[str, float | list[float]]:
    """One run in a process of its own: seconds from start to end, peak memory in MiB, ratios."""
    start = time.perf_counter()
    command = [sys.executable, "-m", "benchmarks.peers", "--one", name, str(n)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    answer: dict[str, float | list[float]] = json.loads(done.stdout.splitlines()[-1])
    return answer | {"seconds": time.perf_counter() - start}


def one(name: str, n: int) -> None:
    """What the process of one run does."""
    ratios = RUNS[name](n)
    used = resource.getrusage(resource.RUSAGE_SELF)
    sys.stdout.write(json.dumps({"ratios": ratios, "cpu": used.ru_utime + used.ru_stime, "peak": used.ru_maxrss / 1024}) + "\n")


def main(folder: Path) -> None:
    """Run all, print and write the table, and the growth with the number of holes."""
    names = [name for name in RUNS if find_spec("ngsolve") or not name.startswith("NGSolve")]
    found = {name: run(name, 30) for name in names}
    rows = []
    for name, result in found.items():
        known = found[REFERENCE["all" in name]]["ratios"]
        error = float(np.abs(np.divide(result["ratios"], known)[:FEW] - 1).max())
        rows.append((name, result["seconds"], result["cpu"], result["peak"], error if name not in REFERENCE.values() else float("nan")))
    growth = [(name, n * n, found[name] if n == 30 else run(name, n)) for n in GROWTH for name in ("femnl, all", "femnl, all, homogenised")]
    with (folder / "peers.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerows([("run", "seconds", "CPU seconds", "peak MiB", "largest error of f/f1 against femnl at full resolution"), *rows])
        writer.writerows([("growth: run", "holes", "seconds", "CPU seconds", "peak MiB")])
        writer.writerows((name, n, r["seconds"], r["cpu"], r["peak"]) for name, n, r in growth)
    sys.stdout.writelines(f"{name:32}{s:8.1f} s {c:8.1f} s CPU {p:7.0f} MiB  {e:9.1e}\n" for name, s, c, p, e in rows)
    _draw(folder / "peers.png", growth)


def _draw(path: Path, growth: list[tuple[str, int, dict[str, float | list[float]]]]) -> None:
    mpl.use("agg")
    from matplotlib import pyplot as plt
    from matplotlib.ticker import NullLocator

    figure, axes = plt.subplots(figsize=(5, 3.6), layout="constrained")
    for name in dict.fromkeys(name for name, _, _ in growth):
        holes, cost = np.array([(n, r["cpu"]) for which, n, r in growth if which == name], dtype=float).T
        power = np.log(cost[-1] / cost[-2]) / np.log(holes[-1] / holes[-2])  # of the last step, where start-up counts least
        axes.loglog(holes, cost, "o-", label=f"{name}: N^{power:.2f}")
        sys.stdout.write(f"{name}: CPU time grows as N^{power:.2f} in the number of holes\n")
    axes.set(xlabel="holes", ylabel="CPU time (s)")
    for axis, places in ((axes.xaxis, [n * n for n in GROWTH]), (axes.yaxis, (1, 2, 5, 10, 20, 50, 100))):
        axis.set_minor_locator(NullLocator())
        axis.set_ticks([float(place) for place in places], labels=[str(place) for place in places])
    axes.legend(frameon=False)
    figure.savefig(path, dpi=150)
    plt.close(figure)


if __name__ == "__main__":
    if "--one" in sys.argv:
        one(sys.argv[-2], int(sys.argv[-1]))
    else:
        main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path())
