"""The perforated film of 900 holes by femnl and by its peers.

Time, peak memory and error of f/f₁, and what up to 10 000 holes cost.

Run `python -m benchmarks.peers [FOLDER]`; it writes peers.csv, peers_growth.csv and peers.png. All
take twelve modes of the square of 30 × 30 holes, each in a process of its own from its start to its
end; nothing is cached. Processor time counts: others may use the machine.
"""

import csv
import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from benchmarks.peers_ngsolve import solve as solve_with_ngsolve
from benchmarks.peers_plain import plain_scikit_fem
from femnl import load
from femnl.core.device import Model
from femnl.core.outline import Holes
from femnl.mechanics.lattice import solve_condensed, solve_homogenised, strain_energies, tile
from femnl.mechanics.nonlinearity import solve_nonlinearity as solve_cubic
from femnl.pipeline import solve_modes, solve_nonlinearity

COUNT = 12
PITCH = 8.56e-6
FEW = 6  # ratios that are compared: doublets of all codes come in one order
QUICK = 3  # degree of what has no error bars: the lowest that leaves 1e-5 of ratios
SIMPLE = 2  # the same of the membrane
GROWTH = (10, 20, 30, 60, 100)  # holes along a side


def device(n: int = 30, bending: bool = True) -> Model:
    """The square of n × n holes with the margin of the shipped one."""
    model: Model = load("square-270um-perforated")
    side = model.outline.length + (n - 30) * PITCH
    factor = side / model.outline.length
    segments = tuple(
        replace(
            s,
            start=(s.start[0] * factor, s.start[1] * factor),
            end=(s.end[0] * factor, s.end[1] * factor),
        )
        for s in model.outline.segments
    )
    outline = replace(model.outline, segments=segments, size=(side, side), length=side)
    places = PITCH * (np.arange(n) - (n - 1) / 2)
    holes = Holes(np.stack(np.meshgrid(places, places), -1).reshape(-1, 2), model.holes.radius)
    smaller: Model = replace(model, outline=outline, holes=holes, bending=bending)
    return smaller


def whole(symmetry: str, n: int) -> list[float]:
    """Modes, α and k₃ of all pairs of modes, all with error bars."""
    modes = solve_modes(device(n), COUNT, symmetry, cache=False)
    solve_nonlinearity(modes, tensor=True, cache=False)
    return [float(r) for r in modes.ratio]


def quick(n: int) -> list[float]:
    """Solve modes, α and k₃ of all pairs by condensed cells of one degree, without error bars."""
    model = device(n)
    modes = solve_condensed(tile(model), COUNT, QUICK)
    solve_cubic(modes, model.edge, tensor=True, energies=partial(strain_energies, edge=model.edge))
    return [float(r) for r in modes.ratio]


def modes_alone(bending: bool, n: int, resolution: float = 1.0, degree: int = QUICK) -> list[float]:
    """Modes by condensed cells of one degree."""
    return [
        float(r) for r in solve_condensed(tile(device(n, bending), resolution), COUNT, degree).ratio
    ]


def homogenised(n: int) -> list[float]:
    """The lattice as an even film: modes, α and k₃ of all pairs of modes."""
    return [float(r) for r in solve_homogenised(device(n), COUNT, tensor=True)[0].ratio]


Run = Callable[[int], list[float]]
WHOLE = "modes with bending, all of α and k₃"
PLATE = "modes with bending"
MEMBRANE = "modes of the membrane"
RUNS: dict[str, dict[str, Run]] = {
    WHOLE: {
        "femnl, one mesh, error bars": partial(whole, "quarter"),
        "femnl, condensed, error bars": partial(whole, "auto"),
        "femnl, condensed": quick,
        "femnl, homogenised": homogenised,
    },
    PLATE: {
        "femnl, condensed": partial(modes_alone, True),
        "NGSolve, tuned": lambda n: solve_with_ngsolve(device(n), COUNT),
    },
    MEMBRANE: {
        "femnl, condensed": partial(modes_alone, False, degree=SIMPLE),
        "NGSolve, tuned": lambda n: solve_with_ngsolve(device(n, bending=False), COUNT),
        "scikit-fem and scipy, plain": lambda n: plain_scikit_fem(device(n, bending=False), COUNT),
    },
}
REFERENCE = {
    bending: partial(modes_alone, bending, resolution=2.0, degree=5) for bending in (True, False)
}


def run(task: str, name: str, n: int) -> dict[str, float | list[float]]:
    """One run in a process of its own: seconds from start to end, peak memory in MiB, ratios."""
    start = time.perf_counter()
    command = [sys.executable, "-m", "benchmarks.peers", "--one", task, name, str(n)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    answer: dict[str, float | list[float]] = json.loads(done.stdout.splitlines()[-1])
    return answer | {"seconds": time.perf_counter() - start}


def one(task: str, name: str, n: int) -> None:
    """What the process of one run does."""
    ratios = REFERENCE[task != MEMBRANE](n) if name == "reference" else RUNS[task][name](n)
    used = resource.getrusage(resource.RUSAGE_SELF)
    sys.stdout.write(
        json.dumps(
            {"ratios": ratios, "cpu": used.ru_utime + used.ru_stime, "peak": used.ru_maxrss / 1024}
        )
        + "\n"
    )


def main(folder: Path) -> None:
    """Run all, print and write the tables, and draw the growth with the number of holes."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    known = {
        bending: run(task, "reference", 30)["ratios"]
        for bending, task in ((True, PLATE), (False, MEMBRANE))
    }
    for task, runs in RUNS.items():
        for name in runs:
            if name.startswith("NGSolve") and not find_spec("ngsolve"):
                continue
            found = run(task, name, 30)
            error = float(
                np.abs(np.divide(found["ratios"], known[task != MEMBRANE])[:FEW] - 1).max()
            )
            rows.append((task, name, found["seconds"], found["cpu"], found["peak"], error))
            sys.stdout.write(
                "{:36}{:30}{:8.1f} s{:8.1f} s CPU{:8.0f} MiB  {:.1e}\n".format(*rows[-1])
            )
            sys.stdout.flush()
    head = (
        "task",
        "by",
        "wall time (s)",
        "processor time (s)",
        "peak memory (MiB)",
        "largest error of f/f1, modes 1 to 6",
    )
    _write(folder / "peers.csv", head, rows)
    growth = []
    for n in GROWTH:
        found = run(WHOLE, "femnl, condensed", n)
        growth.append((n * n, found["seconds"], found["cpu"], found["peak"]))
        sys.stdout.write("{:8d} holes{:8.1f} s{:8.1f} s CPU{:8.0f} MiB\n".format(*growth[-1]))
        sys.stdout.flush()
    _write(
        folder / "peers_growth.csv",
        ("holes", "wall time (s)", "processor time (s)", "peak memory (MiB)"),
        growth,
    )
    _draw(folder / "peers.png", np.array(growth, dtype=float))


def _write(path: Path, head: tuple[str, ...], rows: Sequence[Sequence[object]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([head, *rows])


def _draw(path: Path, growth: np.ndarray) -> None:
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib import pyplot as plt
    from matplotlib.ticker import NullLocator

    holes, _, cost, peak = growth.T
    power = float(np.polyfit(np.log(holes), np.log(cost), 1)[0])
    last = float(np.log(cost[-1] / cost[-2]) / np.log(holes[-1] / holes[-2]))
    sys.stdout.write(f"processor time grows as N^{power:.2f}, in the last step as N^{last:.2f}\n")
    figure, axes = plt.subplots(figsize=(5.2, 3.8), layout="constrained")
    axes.loglog(
        holes,
        cost,
        "o-",
        color="C0",
        label=f"processor time, all: N^{power:.2f}, last step: N^{last:.2f}",
    )
    axes.loglog(holes, cost[-1] * (holes / holes[-1]) ** 1.2, "--", color="0.6", label="N^1.2")
    axes.set(
        xlabel="holes",
        ylabel="processor time (s)",
        title="Twelve modes with bending, all of α and k₃",
    )
    other = axes.twinx()
    other.loglog(holes, peak / 1024, "s:", color="C1", label="peak memory (right)")
    other.set_ylabel("peak memory (GiB)")
    for axis, places in (
        (axes.xaxis, holes),
        (axes.yaxis, (1, 2, 5, 10, 20, 50, 100)),
        (other.yaxis, (0.2, 0.5, 1, 2, 5)),
    ):
        axis.set_minor_locator(NullLocator())
        axis.set_ticks([float(p) for p in places], labels=[f"{p:g}" for p in places])
    lines = [*axes.get_lines(), *other.get_lines()]
    axes.legend(lines, [str(line.get_label()) for line in lines], frameon=False, fontsize="small")
    figure.savefig(path, dpi=150)
    plt.close(figure)


if __name__ == "__main__":
    if "--one" in sys.argv:
        one(sys.argv[-3], sys.argv[-2], int(sys.argv[-1]))
    else:
        main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path())
