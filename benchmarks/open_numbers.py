"""The paper's open number f22 − 2 f11 = 249 Hz of device J10: which film and holes would make it, within what is plausible.

Run `python -m benchmarks.open_numbers [FOLDER]`; it writes open_numbers.csv and open_numbers.png. Every point is the square with its
30 × 30 holes as an even film (see `femnl.lattice`), scaled to the measured f11 = 1.466060 MHz of arXiv:2502.19191.
"""

import csv
import sys
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np

from femnl import load
from femnl.lattice import solve_homogenised
from femnl.types.device import Holes, Model

F11, MEASURED = 1.466060e6, 249.0
RADII = (0.5e-6, 0.75e-6, 0.9e-6, 1.15e-6, 1.4e-6)
THICKNESS = (60e-9, 102e-9, 140e-9, 183.75e-9)
TAPER, TAPER_LENGTH = 60e-9, 3e-6


def detuning(model: Model) -> tuple[float, float]:
    """f22 − 2 f11 [Hz] at the measured f11, and f11 over the measured one with the film's stress and density as given."""
    modes, _ = solve_homogenised(model, 4)
    return float((modes.ratio[3] - 2) * F11), float(modes.frequency[0] / F11)


def main(folder: Path) -> None:
    """Solve the grid, print what comes closest, and draw it."""
    device = load("square-270um-perforated")
    rows = []
    for bending in (True, False):
        for thickness in THICKNESS if bending else THICKNESS[-1:]:
            for radius in RADII:
                for taper in (0.0, min(TAPER, thickness / 3)):
                    film = replace(device.film, thickness=thickness, taper=taper, taper_length=TAPER_LENGTH)
                    model = replace(device, film=film, bending=bending, holes=Holes(np.array(device.holes.centres), radius))
                    rows.append((bending, thickness * 1e9, radius * 1e6, taper * 1e9, *detuning(model)))
    with (folder / "open_numbers.csv").open("w", newline="", encoding="utf-8") as file:
        head = ("bending", "thickness (nm)", "hole radius (um)", "taper (nm)", "f22 - 2 f11 (Hz)", "f11 / measured")
        csv.writer(file).writerows([head, *rows])
    closest = min(rows, key=lambda row: abs(row[4] - MEASURED))
    printed = min(row[4] for row in rows if row[0] and row[1] > 180)
    sys.stdout.write(
        f"closest: bending {closest[0]}, h = {closest[1]:.0f} nm, r = {closest[2]:.2f} um, taper {closest[3]:.0f} nm: {closest[4]:.0f} Hz\n"
    )
    sys.stdout.write(
        f"with the printed thickness and bending, no radius or taper here goes below {printed:.0f} Hz; measured: {MEASURED:.0f} Hz\n"
    )
    _draw(folder / "open_numbers.png", rows)


def _draw(path: Path, rows: list[tuple[bool, float, float, float, float, float]]) -> None:
    mpl.use("agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(5.5, 3.8), layout="constrained")
    for k, film in enumerate(dict.fromkeys(row[:2] for row in rows)):
        for tapered, style in ((False, "o-"), (True, "s--")):
            radius, hertz = np.array([row[2:5:2] for row in rows if row[:2] == film and (row[3] > 0) == tapered]).T
            name = f"{film[1]:.0f} nm" if film[0] else "no bending"
            axes.plot(radius, hertz, style, color=f"C{k}", label=None if tapered else name)
    axes.axhline(MEASURED, color="0.4", lw=1)
    axes.text(RADII[-1] * 1e6, MEASURED, "measured", ha="right", va="bottom", color="0.4")
    axes.set(xlabel="hole radius (µm)", ylabel="f₂₂ − 2 f₁₁ (Hz)", title="dashed: tapered towards the holes")
    figure.legend(frameon=False, fontsize="small", title="film", loc="outside right upper")
    figure.savefig(path, dpi=150)
    plt.close(figure)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path())
