"""Error of displacement calibrations against a known amplitude, z = 0.1 … 12.

a Taylor expansion at one spot, and whole maps.

Run `python -m benchmarks.calibration [FOLDER]`; it writes calibration.csv, its summary, and
calibration.png. The Taylor method gets exact harmonics of the best spot; the map fits get 25 × 25
points with noise of 1.5 % of the fringe and find placement, phase and working point as well.
"""

import csv
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import femnl
from femnl.core.readout import PeriodicFringe
from femnl.fits.map.calibration import taylor_amplitude
from femnl.fits.map.fit import fit_map
from femnl.io.measurement import harmonic_map
from femnl.optics.harmonics import harmonics
from femnl.plot.style import COLOURS, new_figure, style

Array = NDArray[np.float64]
Row = dict[str, str | float]

WAVELENGTH = 632.8e-9
SIDE = 270e-6
HARMONICS = range(1, 7)
NOISE = 0.015
DEPTHS = np.concatenate([[0.1, 0.2, 0.3, 0.5, 0.7], np.arange(1.0, 12.1, 0.5)])
METHODS = {
    "Taylor, one spot, 3f/1f": ("-", COLOURS[1]),
    "Taylor, one spot, 4f/2f": ("--", COLOURS[4]),
    "map, sine": ("o", COLOURS[0]),
    "map, form of the fringe free": ("s", COLOURS[2]),
    "map, stack known": ("^", COLOURS[6]),
}


def shape(x: Array, y: Array) -> Array:
    """Mode (1,1) of an ideal square membrane."""
    inside = (np.abs(x) < SIDE / 2) & (np.abs(y) < SIDE / 2)
    return np.where(inside, np.cos(np.pi * x / SIDE) * np.cos(np.pi * y / SIDE), 0.0)


def errors(fringe: PeriodicFringe, depth: float, seed: int) -> Iterator[tuple[str, float, float]]:
    """Yield method, relative error of the amplitude and its stated standard deviation."""
    U = depth * WAVELENGTH / (4 * np.pi)
    odd, even = taylor_amplitude(harmonics(fringe, (1, 2, 3, 4), U), WAVELENGTH)
    yield "Taylor, one spot, 3f/1f", float(odd / U - 1), float("nan")
    yield "Taylor, one spot, 4f/2f", float(even / U - 1), float("nan")
    axis = np.linspace(-160e-6, 160e-6, 25)
    rng = np.random.default_rng(seed)
    V = harmonics(fringe, HARMONICS, U * shape(*np.meshgrid(axis, axis)), 0.3)
    noise = NOISE * abs(fringe.fourier.coefficients[1])
    V = V + noise * (rng.normal(size=V.shape) + 1j * rng.normal(size=V.shape))
    data = harmonic_map(axis, axis, HARMONICS, V, noise_sd=noise, wavelength=WAVELENGTH)
    fits = {"map, sine": fit_map(data, shape)}
    if len(fringe.fourier.coefficients) > 2:
        fits["map, form of the fringe free"] = fit_map(data, shape, free_overtones=5)
        fits["map, stack known"] = fit_map(data, shape, fringe)
    for name, fit in fits.items():
        amplitude = fit.fit.parameters["amplitude"]
        yield name, amplitude.value / U - 1, amplitude.sd / U


def run(folder: Path) -> Path:
    """Compare the methods on a sine and on the stack of the paper.

    Write table and figure and return the figure's path.
    """
    stack = femnl.load("square-270um").stack
    fringes: dict[str, femnl.SineFringe | femnl.MultilayerFringe] = {
        "data: a sine": femnl.SineFringe(WAVELENGTH, 0.0, 1.0, 0.6),
        "data: film, gap and wafer": femnl.MultilayerFringe(stack, WAVELENGTH),
    }
    rows: list[Row] = [
        {"fringe": label, "z": float(z), "method": method, "relative_error": error, "stated_sd": sd}
        for label, fringe in fringes.items()
        for i, z in enumerate(DEPTHS)
        for method, error, sd in errors(fringe, float(z), i)
    ]
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "calibration.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    with (folder / "calibration-summary.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(summary(rows))
    return draw(rows, list(fringes), folder / "calibration.png")


def summary(rows: list[Row]) -> list[tuple[str | float, ...]]:
    """Return the errors of the amplitude by fringe and method.

    The median of |relative error| below z = 1 and from there on, and the largest from z = 1 on.
    """
    table: list[tuple[str | float, ...]] = [
        ("data and method", "median, z < 1", "median, z ≥ 1", "largest, z ≥ 1")
    ]
    for pair in dict.fromkeys((row["fringe"], row["method"]) for row in rows):
        own = [row for row in rows if (row["fringe"], row["method"]) == pair]
        below, above = (
            [abs(float(r["relative_error"])) for r in own if (float(r["z"]) >= 1) == deep]
            for deep in (False, True)
        )
        table.append(
            (f"{pair[0]}; {pair[1]}", float(np.median(below)), float(np.median(above)), max(above))
        )
    return table


def draw(rows: list[Row], labels: list[str], path: Path) -> Path:
    """Draw |relative error| against z, one panel a fringe."""
    with style():
        figure = new_figure(height=3.5)
        panels = figure.subplots(1, len(labels), sharey=True)
        for panel, label in zip(panels, labels, strict=True):
            for method, (mark, colour) in METHODS.items():
                points = [
                    (row["z"], abs(float(row["relative_error"])))
                    for row in rows
                    if (row["fringe"], row["method"]) == (label, method)
                ]
                if points:
                    line = mark in ("-", "--")
                    panel.plot(
                        *zip(*points, strict=True),
                        mark,
                        color=colour,
                        label=method,
                        linewidth=1.2 if line else 0,
                        markersize=4,
                    )
            panel.set(
                yscale="log",
                ylim=(1e-5, 10),
                xlim=(0, 12.3),
                xlabel="modulation depth z = 4πU/λ",
                title=label,
            )
        panels[0].set_ylabel("|error of the amplitude| / amplitude")
        figure.legend(*panels[-1].get_legend_handles_labels(), loc="outside lower center", ncols=3)
        figure.savefig(path)
    return path


if __name__ == "__main__":
    run(Path(sys.argv[1] if len(sys.argv) > 1 else "report/benchmarks"))
