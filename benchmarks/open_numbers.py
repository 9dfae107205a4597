"""The paper's open numbers: f22 − 2 f11 = 249 Hz of device J10, and the ten ratios of the hexagon.

Which film, holes and edge make them.

Run `python -m benchmarks.open_numbers [FOLDER] [--full]`; it writes open_numbers.csv and
open_numbers.png. The scans take the square with its 30 × 30 holes as an even film
(`femnl.mechanics.lattice`), and every number is scaled to the measured f11 = 1.466060 MHz of
arXiv:2502.19191. `--full` solves the etched, tapered, perforated devices themselves, which takes
minutes.
"""

import csv
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

from benchmarks.ledge import SIDE, edge_by_solid, etched, on_ledge
from benchmarks.ledge_section import OXIDE, Ledge, solve_ledge
from benchmarks.ledge_solid import Moved
from benchmarks.measured import RATIOS
from femnl import load, solve_modes
from femnl.core.device import Clamp, Film, Model
from femnl.core.outline import Holes
from femnl.mechanics.lattice import solve_homogenised

Array = NDArray[np.float64]

F11 = 1.466060e6
MEASURED = 249.0
# film as deposited and as read off by light, and the gap; supplement S1, S6
DEPOSITED = 315e-9
LEFT = 183.75e-9
GAP = 3226.25e-9
RADII = (0.5e-6, 0.75e-6, 0.9e-6, 1.15e-6, 1.4e-6)
THICKNESS = (60e-9, 102e-9, 140e-9, LEFT)
ARRAY = 0.9145 * LEFT  # tension of the relaxed film over its stress [m]
DRAWN = np.array([0.0, 4e-9, 8e-9, 12e-9, 16e-9, 20e-9, 24e-9])  # of the edge, inwards
PRESSURE = 280e6  # of the oxide, as grown near 1000 °C


def tapered(film: Film) -> Film:
    """The film that the etch leaves if it took from below what the gap is wider than the oxide."""
    return etched(film, GAP - OXIDE)


def springs(ledge: Ledge, moved: Moved, film: Film, pressure: float) -> Clamp:
    """Return the edge as springs that move it evenly, by as much as the middle of a side moves.

    The true edge moves less towards its corners, which changes f22 − 2 f11 far less.
    """
    normal, shear = ledge.springs(SIDE / 2)
    tension = film.stress * film.thickness
    inwards = moved.inwards[:, 0] @ np.array([pressure, tension, tension, film.stress * ARRAY])
    pull = film.stress * ARRAY
    return Clamp(normal=normal, shear=shear, draw=float(inwards - pull / normal))


def detuning(model: Model) -> float:
    """f22 − 2 f11 [Hz] at the measured f11, of the even film."""
    modes, _ = solve_homogenised(model, 4)
    return float((modes.ratio[3] - 2) * F11)


def with_radius(device: Model, radius: float) -> Model:
    """The device with holes of another radius."""
    return replace(device, holes=Holes(np.array(device.holes.centres), radius))


def rigid_edges(device: Model) -> Iterator[tuple[str, float, float, float, float]]:
    """Return film, holes [nm, µm], taper [nm] and f22 − 2 f11 [Hz] with stiff edges."""
    for bending in (True, False):
        for thickness in THICKNESS if bending else THICKNESS[-1:]:
            for radius in RADII:
                model = with_radius(
                    replace(
                        device, film=replace(device.film, thickness=thickness), bending=bending
                    ),
                    radius,
                )
                yield (
                    "bending" if bending else "no bending",
                    thickness * 1e9,
                    round(radius * 1e6, 3),
                    0.0,
                    detuning(model),
                )
    film = tapered(device.film)
    for radius in RADII:
        model = with_radius(replace(device, film=film), radius)
        yield (
            "bending",
            film.thickness * 1e9,
            round(radius * 1e6, 3),
            film.taper * 1e9,
            detuning(model),
        )


def yielding_edges(device: Model, ledge: Ledge) -> Array:
    """f22 − 2 f11 [Hz] where the edge moves inwards by `DRAWN`.

    Springs of the ledge, at rest so that they end there.
    """
    found = []
    for inwards in DRAWN:
        pull = device.film.stress * ARRAY
        normal, shear = ledge.springs(SIDE / 2)
        clamp = Clamp(normal=normal, shear=shear, draw=float(inwards - pull / normal))
        found.append(detuning(replace(device, clamp=clamp)))
    return np.array(found)


def full() -> None:
    """The device itself: outline as etched, all holes, with the error bars of the elements."""
    etched_edge = load("square-270um-etched")
    cases = {
        "straight edges": load("square-270um-perforated"),
        "etched outline": etched_edge,
        "etched outline, tapered": replace(etched_edge, film=tapered(etched_edge.film)),
    }
    for name, model in cases.items():
        modes = solve_modes(model, 4)
        hertz = (modes.ratio[3] - 2) * F11
        error = modes.ratio_error[3] * F11
        sys.stdout.write(
            f"{name}: f22 − 2 f11 = {hertz:.0f} ± {error:.0f} Hz, f11 = "
            f"{modes.frequency[0] / F11:.4f} of the measured\n"
        )


def hexagon(ledge: Ledge, moved: Moved) -> None:
    """Return the rms deviation of the hexagon's ten ratios from those of each candidate film."""
    even = load("hexagon-278um")
    holes = load("hexagon-278um-perforated")
    film = tapered(even.film)
    clamp = springs(ledge, moved, film, PRESSURE)
    cases = {
        "even film": even,
        "even film of 315 nm, as deposited": replace(
            even, film=replace(even.film, thickness=DEPOSITED)
        ),
        "even film of 402 nm": replace(even, film=replace(even.film, thickness=402e-9)),
        "hinged edge": replace(even, clamp=Clamp(rotation=0.0)),
        "holes": holes,
        "holes of 1.4 um": with_radius(holes, RADII[-1]),
        "film of 315 nm, holes of 1.4 um": with_radius(
            replace(holes, film=replace(holes.film, thickness=DEPOSITED)), RADII[-1]
        ),
        "holes, tapered": replace(holes, film=film),
        "holes, tapered, on its ledge": replace(holes, film=film, clamp=clamp),
    }
    for name, model in cases.items():
        modes = solve_modes(model, len(RATIOS), resolution=0.8)
        away = modes.ratio[1:] / RATIOS[1:] - 1
        error = (modes.ratio_error / modes.ratio).max()
        sys.stdout.write(
            f"hexagon, {name}: {np.sqrt(np.mean(away**2)) * 1e6:.0f} ppm rms, the elements' own "
            f"error {error * 1e6:.0f} ppm\n"
        )


def main(folder: Path, whole: bool) -> None:
    """Scan, print what comes closest and how plausible it is, and draw it."""
    folder.mkdir(parents=True, exist_ok=True)
    device = load("square-270um-perforated")
    ledge = solve_ledge(tapered(device.film).thickness)
    rows = list(rigid_edges(device))
    with (folder / "open_numbers.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(
            [
                ("film", "thickness (nm)", "hole radius (um)", "taper (nm)", "f22 - 2 f11 (Hz)"),
                *rows,
            ]
        )
    printed = [row for row in rows if row[0] == "bending" and row[1] > 180]
    wide = [row for row in printed if row[3] > 0]
    low = min(row[4] for row in printed)
    high = max(row[4] for row in printed)
    thin = ", ".join(
        f"{row[1]:.0f} nm {row[0]}: {row[4]:.0f} Hz"
        for row in rows
        if row[2] == 0.9 and row[3] == 0
    )
    sys.stdout.write(f"rigid edges, holes of 0.9 um: {thin}\n")
    sys.stdout.write(
        "rigid edges, films of the printed thickness, all radii, with and without taper: "
        f"{low:.0f} … {high:.0f} Hz\n"
    )
    sys.stdout.write(
        "tapered: " + ", ".join(f"{row[4]:.0f} Hz at {row[2]:.2f} um" for row in wide) + "\n"
    )
    even, taper = (
        yielding_edges(replace(device, film=f), ledge) for f in (device.film, tapered(device.film))
    )
    for name, curve in (("even", even), ("tapered", taper)):
        wanted = np.interp(-MEASURED, -curve, DRAWN)
        slope = (curve[0] - curve[-1]) / DRAWN[-1] * 1e-9
        sys.stdout.write(
            f"{name} film: {slope:.0f} Hz less for every nm that the edge moves inwards; "
            f"{MEASURED:.0f} Hz at "
            f"{wanted * 1e9:.1f} nm\n"
        )
    film = tapered(device.film)
    tapered_device = replace(device, film=film)
    normal, shear = ledge.springs(SIDE / 2)
    moved = edge_by_solid(device)
    push = moved.inwards[0, 0] * PRESSURE * 1e9
    sys.stdout.write(
        f"film as the etch left it: {film.thickness * 1e9:.0f} nm at the edge, "
        f"{film.taper * 1e9:.0f} "
        "nm less "
        "at the rims of holes\n"
        f"ledge of oxide: {normal * 1e-9:.1f} GPa across, {shear * 1e-9:.1f} GPa along; oxide "
        f"under -280 MPa pushes the middle of an edge {push:.1f} nm\n"
        f"tapered film, holes even, on its ledge: {on_ledge(tapered_device, moved, PRESSURE):.0f} "
        f"Hz, and with rigid edges {detuning(tapered_device):.0f} Hz\n"
    )
    _draw(folder / "open_numbers.png", rows, even, taper)
    if whole:
        full()
        hexagon(ledge, moved)


def _draw(
    path: Path, rows: list[tuple[str, float, float, float, float]], even: Array, taper: Array
) -> None:
    mpl.use("agg")
    from matplotlib import pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained", sharey=True)
    for film in dict.fromkeys((row[0], row[1], row[3] > 0) for row in rows):
        radius, hertz = np.array(
            [(row[2], row[4]) for row in rows if (row[0], row[1], row[3] > 0) == film]
        ).T
        name = (
            "no bending"
            if film[0] == "no bending"
            else f"{film[1]:.0f} nm{', tapered' if film[2] else ''}"
        )
        left.plot(radius, hertz, "s--" if film[2] else "o-", label=name)
    left.set(xlabel="hole radius (µm)", ylabel="f₂₂ − 2 f₁₁ (Hz)", title="rigid edges")
    right.plot(DRAWN * 1e9, even, "o-", label="even film")
    right.plot(DRAWN * 1e9, taper, "s--", label="tapered film")
    right.set(xlabel="edge moved inwards by (nm)", title="edges that give way")
    right.legend(frameon=False, fontsize="small")
    for axes in (left, right):
        axes.axhline(MEASURED, color="0.4", lw=1)
        axes.annotate(
            "measured",
            (0, MEASURED),
            xycoords=("axes fraction", "data"),
            xytext=(4, 3),
            textcoords="offset points",
            color="0.4",
        )
    figure.legend(
        *left.get_legend_handles_labels(),
        frameon=False,
        fontsize="small",
        title="rigid edges, film",
        loc="outside right center",
    )
    figure.savefig(path, dpi=150)
    plt.close(figure)


if __name__ == "__main__":
    given = [word for word in sys.argv[1:] if word != "--full"]
    main(Path(given[0]) if given else Path(), "--full" in sys.argv)
