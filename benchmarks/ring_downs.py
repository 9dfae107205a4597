"""Ring-downs of a laboratory against the quality factors that its people found by hand.

    python benchmarks/ring_downs.py FOLDER TABLE.csv

FOLDER holds records of an analyser, TABLE.csv a row for each with the columns record, sample, mode,
type, frequency_Hz, quality_factor and notes; a record's number is the first number of its file's
name. The chips, which are the begin of the sample's name up to the hyphen, are taken in two halves
by turns of their sorted names. Printed are the parts within 10 % and 3 % of the table, how repeats
of one mode scatter, and every record that differs by more than 10 %.
"""

import csv
import re
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

from femnl.core.errors import MeasurementError
from femnl.fits.decay.power import fit_decay
from femnl.io.labfiles import read_lab_files

SAME_MODE = 1e-3
"""Relative difference of frequencies within which records of one sample and mode repeat it."""
MISLABELLED = 2.0
"""Repeats whose quality factors by hand differ by this factor are not of one mode."""


@dataclass(frozen=True)
class Row:
    """One record: its place in the table, Q of the table and as fitted with its sd, and words."""

    record: str
    half: int
    repeats: str
    frequency: float
    by_hand: float
    quality: float
    sd: float
    terms: str

    @property
    def ratio(self) -> float:
        """Q as fitted over Q by hand."""
        return self.quality / self.by_hand


def say(*texts: str) -> None:
    """Write a line."""
    sys.stdout.write("".join(texts) + "\n")


def fit_all(folder: Path, table: Path) -> list[Row]:
    """Fit every ring-down of the table that is in the folder."""
    with table.open(encoding="utf-8") as file:
        known = {row["record"]: row for row in csv.DictReader(file)}
    files = {re.findall(r"\d+", path.name)[0]: path for path in sorted(folder.glob("*.txt"))}
    listed = [known[number] for number in files if number in known]
    wanted = [row for row in listed if row["type"] == "ringdown" and row["quality_factor"]]
    chips = sorted({row["sample"].split("-")[0] for row in wanted})
    rows = []
    for row in wanted:
        try:
            (node,) = read_lab_files(files[row["record"]]).children.values()
            fit = fit_decay(node.to_dataset())
        except MeasurementError as error:
            say(f"{row['record']}: {error}")
            continue
        quality = fit.fit.parameters["quality_factor"]
        terms = [n for n in ("damping_ratio", "exit_rate", "partner") if n in fit.fit.parameters]
        rows.append(
            Row(
                row["record"],
                chips.index(row["sample"].split("-")[0]) % 2,
                f"{row['sample']} {row['mode']}",
                float(row["frequency_Hz"]),
                float(row["quality_factor"]),
                quality.value,
                quality.sd,
                ", ".join(terms),
            )
        )
    return rows


def repeats(rows: Sequence[Row]) -> list[list[Row]]:
    """Return groups of two and more records of one mode of one sample at one frequency."""
    groups: list[list[Row]] = []
    for row in sorted(rows, key=lambda row: (row.repeats, row.frequency)):
        last = groups[-1][-1] if groups else None
        near = last is not None and row.frequency < last.frequency * (1 + SAME_MODE)
        if near and last is not None and last.repeats == row.repeats:
            groups[-1].append(row)
        else:
            groups.append([row])
    several = [group for group in groups if len(group) > 1]
    return [
        group
        for group in several
        if max(row.by_hand for row in group) < MISLABELLED * min(row.by_hand for row in group)
    ]


def scatter(groups: Sequence[Sequence[Row]], name: str) -> float:
    """Return the median distance of ln Q from the mean of its group, for one column of rows."""
    away = []
    for group in groups:
        value = np.log([getattr(row, name) for row in group])
        away += list((value - value.mean()) * np.sqrt(len(group) / (len(group) - 1)))
    return float(np.median(np.abs(away)))


def chi2(groups: Sequence[Sequence[Row]], spread: float) -> float:
    """Return reduced χ² of ln Q about the mean of each group, with a common spread added."""
    total = 0.0
    free = 0
    for group in groups:
        value = np.log([row.quality for row in group])
        sd = np.array([row.sd / row.quality for row in group])
        weight = 1 / (sd**2 + spread**2)
        mean = np.sum(weight * value) / np.sum(weight)
        total += float(np.sum(weight * (value - mean) ** 2))
        free += len(group) - 1
    return total / free


def report(name: str, rows: Sequence[Row]) -> None:
    """Write how many records agree."""
    away = np.abs(np.log([row.ratio for row in rows]))
    ten = 100 * np.mean(away < np.log(1.1))
    three = 100 * np.mean(away < np.log(1.03))
    middle = np.median([row.ratio for row in rows])
    say(
        f"{name}: {len(rows)} records, {ten:.1f} % within 10 %, {three:.1f} % within 3 %, ",
        f"median ratio {middle:.4f}",
    )


def main(folder: str, table: str) -> None:
    """Print the study."""
    start = time.perf_counter()
    rows = fit_all(Path(folder), Path(table))
    say(f"{len(rows)} records in {time.perf_counter() - start:.0f} s")
    report("all", rows)
    for half in (0, 1):
        report(f"half {half + 1} of the chips", [row for row in rows if row.half == half])
    for name, few in (("straight", True), ("with a term", False)):
        report(name, [row for row in rows if (not row.terms) == few])
    first = repeats([row for row in rows if row.half == 0])
    second = repeats([row for row in rows if row.half == 1])
    spread = float(brentq(lambda s: chi2(first, s) - 1, 1e-5, 1.0))
    say(f"day-to-day spread of Q from repeats in the first half: {100 * spread:.2f} %")
    for name, groups in (("first", first), ("second", second)):
        fitted = 100 * scatter(groups, "quality")
        by_hand = 100 * scatter(groups, "by_hand")
        say(
            f"{name} half: {sum(map(len, groups))} repeats of {len(groups)} modes, χ²/ν of the ",
            f"stated sd {chi2(groups, 0.0):.0f}, with the spread {chi2(groups, spread):.2f}; ",
            f"median scatter {fitted:.2f} %, by hand {by_hand:.2f} %",
        )
    say("differ by more than 10 %, or by more than 3 % with a term:")
    for row in rows:
        limit = np.log(1.03) if row.terms else np.log(1.1)
        if abs(np.log(row.ratio)) > limit:
            sd = row.sd / row.by_hand
            say(f"  {row.record}: {row.ratio:.3f} ± {sd:.3f} of {row.by_hand:.3g} {row.terms}")


if __name__ == "__main__":
    main(*sys.argv[1:])
