"""Real chips: `python benchmarks/chips.py FOLDER`, which holds decays.csv of the ring-downs.

Every chip whose devices are named by two digits, and which has eight and more of designs of four
and more, is fitted; the table says how well a device is predicted by all others.
"""

import argparse
import csv
import re
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from femnl.chip import ChipFit, fit_chip, read_chip
from femnl.chip.members import Chip
from femnl.chip.result import LeftOut, Quantity

NAMED = re.compile(r"(.+-)[0-9]{2}")
STUDY = """
name = "{chip}"
[table]
file = "{file}"
chip = "{chip}"
[table.columns]
device = "sample"
frequency = "frequency_Hz"
[positions]
pattern = "^(?P<y>[0-9])(?P<x>[0-9])$"
"""
FEWEST = 8
OF_A_DESIGN = 4


def chips(path: Path) -> list[Chip]:
    """Read every chip of a table that has enough devices that are alike."""
    with path.open(encoding="utf-8", newline="") as file:
        names = {row["sample"] for row in csv.DictReader(file)}
    whole = [match[1] for name in sorted(names) if (match := NAMED.fullmatch(name))]
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for chip, count in Counter(whole).items():
            others = [n for n in names if n.startswith(chip) and len(n) != len(chip) + 2]
            # Longer names are of no grid
            if count < FEWEST or others:
                continue
            study = Path(folder) / "chip.toml"
            study.write_text(STUDY.format(chip=chip, file=path.resolve()), encoding="utf-8")
            read = read_chip(study)
            many = Counter(m.design for m in read.members)
            members = tuple(m for m in read.members if many[m.design] >= OF_A_DESIGN)
            if len(members) >= FEWEST:
                found.append(Chip(chip.rstrip("-"), members, {}, read.notes, read.unit))
    return found


def row(name: str, quantity: Quantity, seconds: float) -> str:
    """Return a row of the table."""
    one = quantity.left_out
    forms = " ".join(f"{p:.2f}" for p in quantity.fields.values())
    odd = ", ".join(sorted({d.device for d in quantity.devices if d.odd})) or "–"
    return (
        f"| {name} | {quantity.name} | {one.count} | {forms} | {100 * one.error:.3g} % | "
        f"{100 * one.plain_error:.3g} % | {one.error / one.plain_error:.2f} | {one.coverage:.2f} | "
        f"{odd} | {seconds:.1f} |"
    )


def summary(quantities: list[Quantity]) -> str:
    """Return what all chips say of one quantity."""
    parts: list[LeftOut] = [q.left_out for q in quantities]
    ratio = np.array([p.error / p.plain_error for p in parts])
    varies = np.array([q.varies > 0.95 for q in quantities])
    numbers = sum(p.count for p in parts)
    held = sum(p.coverage * p.count for p in parts) / numbers
    return (
        f"{quantities[0].name}: {len(parts)} chips, {numbers} numbers; ratio of errors, geometric "
        f"mean {np.exp(np.log(ratio).mean()):.2f}; {varies.sum()} vary (95 %), their median ratio "
        f"{np.median(ratio[varies]):.2f}, {np.sum(ratio[varies] <= 0.5)} at most a half; "
        f"{np.sum(ratio > 1.05)} above 1.05; 68 % intervals hold {held:.3f}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="real chips")
    parser.add_argument("folder", type=Path)
    given = parser.parse_args()
    fits: list[ChipFit] = []
    sys.stdout.write(
        "| chip | quantity | numbers | none, plane, bowl | error left out | by the mean | ratio | "
        "held | outliers | s |\n|" + "---|" * 10 + "\n"
    )
    for chip in chips(given.folder / "decays.csv"):
        start = time.process_time()
        fit = fit_chip(chip)
        fits.append(fit)
        seconds = time.process_time() - start
        for quantity in (fit.frequency, fit.quality):
            if quantity is not None:
                sys.stdout.write(row(chip.name, quantity, seconds) + "\n")
                sys.stdout.flush()
    sys.stdout.write("\n" + summary([fit.frequency for fit in fits]) + "\n")
    sys.stdout.write(summary([fit.quality for fit in fits if fit.quality is not None]) + "\n")


if __name__ == "__main__":
    main()
