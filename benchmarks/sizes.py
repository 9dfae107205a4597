"""Memory and time of show, fit and diagnose against the size of a file, for each kind.

Run `python -m benchmarks.sizes [FOLDER] [--kind KIND] [--command COMMAND]`; it writes sizes.csv:
seconds of processor time, peak memory, and the bytes of memory for each byte of numbers that a file
has more than the smallest of its kind. What a kind states as `size` in its package of
`femnl/observe`, by which femnl refuses files that are too large before it reads them, is this
factor with a margin of a half, and the number of data for ten minutes of one processor. Signals are
seeded, and explained by their model; a diagnosis that has something to explain takes longer.
"""

import argparse
import csv
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from femnl.io import measurement
from femnl.optics.fringe import SineFringe
from femnl.optics.harmonics import harmonics

COMMANDS = ("show", "fit", "diagnose")
HEAD = ("kind", "command", "data", "file [MiB]", "processor [s]", "peak [MiB]", "factor", "exit")
DEVICE = "square-270um"
LONGEST = 300.0
"""Seconds of processor time after which a command is ended."""


def response(points: int, rng: np.random.Generator) -> xr.Dataset:
    """One linear resonance of Q 25 000 with noise of 1e-2 of its top, one sweep."""
    frequency = np.linspace(1e6, 1.001e6, points)
    noise = rng.normal(size=(2, points))
    volts = 1e-3 * 20 / (frequency - 1.0005e6 + 20j) + 1e-5 * (noise[0] + 1j * noise[1])
    return measurement.response(frequency[None], volts[None], drive=[1.0], direction=[1])


def sweeps(points: int, rng: np.random.Generator) -> xr.Dataset:
    """Twenty such sweeps of as many points in all."""
    parts = [response(points // 20, rng) for _ in range(20)]
    volts = np.concatenate([part["real"].values + 1j * part["imag"].values for part in parts])
    frequency = np.concatenate([part["frequency"].values for part in parts])
    return measurement.response(frequency, volts, drive=np.ones(20), direction=np.ones(20))


def series(points: int, rng: np.random.Generator) -> xr.Dataset:
    """The quality factor against the pressure of a gas."""
    pressure = np.linspace(1, 100, points)
    quality = 1e5 / (1 + pressure / 30) * (1 + 0.01 * rng.normal(size=points))
    errors = 0.01 * quality
    return measurement.series(
        {"pressure": pressure}, quality_factor=quality, quality_factor_sd=errors
    )


def spectrum(lines: int, rng: np.random.Generator) -> xr.Dataset:
    """Lines as dense as those of a drum, but not its own."""
    frequency = 3.4e6 * np.sqrt(np.arange(1, lines + 1)) * (1 + 1e-4 * rng.normal(size=lines))
    return measurement.spectrum(np.sort(frequency), np.full(lines, 10.0))


def harmonic_map(pixels: int, rng: np.random.Generator) -> xr.Dataset:
    """Six harmonics of a square film's first mode through a sine fringe, on a square of pixels."""
    side = int(np.sqrt(pixels))
    place = np.linspace(-1.35e-4, 1.35e-4, side)
    shape = np.cos(np.pi * place[:, None] / 2.7e-4) * np.cos(np.pi * place / 2.7e-4)
    fringe = SineFringe(632.8e-9, 0.0, 1.0, 0.8)
    harmonic = np.arange(1, 7)
    volts = harmonics(fringe, harmonic, 2e-7 * shape)
    noise = 1e-3 * rng.normal(size=(2, *volts.shape))
    return measurement.harmonic_map(
        place, place, harmonic, volts + noise[0] + 1j * noise[1], noise_sd=1e-3, wavelength=632.8e-9
    )


def trace(samples: int, rng: np.random.Generator) -> xr.Dataset:
    """A sine of 1 MHz behind a sine fringe, 50 samples a period, one step."""
    time_ = np.arange(samples) * 2e-8
    volts = np.sin(4 * np.pi / 632.8e-9 * 1e-7 * np.cos(2 * np.pi * 1e6 * time_) + 0.8)
    noisy = volts + 0.01 * rng.normal(size=samples)
    return measurement.trace(
        time_, noisy, drive_frequency=[1e6], wavelength=632.8e-9, noise_sd=0.01
    )


def record(samples: int, rng: np.random.Generator) -> xr.Dataset:
    """Noise that drives a damped oscillator in steps of 1.6 ms."""
    drive = rng.normal(size=samples)
    out = np.zeros(samples)
    for n in range(2, samples):
        out[n] = 1.6 * out[n - 1] - 0.95 * out[n - 2] + 0.1 * drive[n - 1]
    step = 1.6e-3
    return measurement.trace(
        np.arange(samples) * step, out + 1e-3 * rng.normal(size=samples), drive_voltage=drive
    )


def decay(points: int, rng: np.random.Generator) -> xr.Dataset:
    """An exponential fall by 80 dB in half the record, then the floor."""
    time_ = np.linspace(0, 100, points)
    power = np.logaddexp(-40 - 2 * time_, -110) + rng.normal(size=points)
    return measurement.decay(time_, power, attributes={"frequency": 1e6})


@dataclass(frozen=True)
class Case:
    """A maker of files, the sizes that are measured, and options of a fit."""

    make: Callable[[int, np.random.Generator], xr.Dataset]
    sizes: tuple[int, ...]
    fit: tuple[str, ...] = ()


CASES = {
    "response": Case(response, (10_000, 100_000, 1_000_000)),
    "sweeps": Case(sweeps, (10_000, 100_000, 1_000_000)),
    "series": Case(series, (10_000, 100_000, 1_000_000)),
    "spectrum": Case(spectrum, (30, 100, 300)),
    "map": Case(harmonic_map, (10_000, 90_000, 360_000)),
    "trace": Case(trace, (100_000, 1_000_000, 4_000_000)),
    "record": Case(record, (100_000, 1_000_000), ("--as", "oscillator")),
    "decay": Case(decay, (10_000, 100_000, 1_000_000)),
}


def measured(command: str, file: Path, case: Case) -> tuple[float, int, int]:
    """Run a command on a file: seconds of processor time, peak memory in bytes, exit code."""
    out = ["--out", str(file.parent / "out")]
    options = {"show": out, "fit": [*case.fit], "diagnose": [*out, "--workers", "1"]}
    words = [sys.executable, "-m", "femnl", command, str(file), *options[command]]
    cache = {"XDG_CACHE_HOME": str(file.parent / "cache")}

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (int(LONGEST), int(LONGEST)))

    process = subprocess.Popen(
        words,
        env=os.environ | cache,
        stdout=subprocess.DEVNULL,
        stderr=(file.parent / "stderr").open("wb"),
        preexec_fn=limit,
    )
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return used.ru_utime + used.ru_stime, used.ru_maxrss * 1024, process.returncode


def rows(kinds: list[str], commands: list[str], sizes: list[int]) -> Iterator[list[str]]:
    """Measure each command on files of each kind; sizes: those of the kind where none are given."""
    for kind in kinds:
        case = CASES[kind]
        first: dict[str, tuple[int, int]] = {}
        for size in sizes or case.sizes:
            with tempfile.TemporaryDirectory() as name:
                file = Path(name) / "f.nc"
                dataset = case.make(size, np.random.default_rng(1))
                measurement.write(measurement.bundle({"data": dataset}, geometry=DEVICE), file)
                held = dataset.nbytes
                for command in commands:
                    seconds, peak, code = measured(command, file, case)
                    least, lowest = first.setdefault(command, (held, peak))
                    factor = (peak - lowest) / (held - least) if held > least else 0.0
                    numbers = [f"{size}", f"{held / 2**20:.3g}", f"{seconds:.1f}"]
                    memory = [f"{peak / 2**20:.0f}", f"{factor:.1f}"]
                    yield [kind, command, *numbers, *memory, f"{code}"]


def main() -> None:
    """Measure what was asked for, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path())
    parser.add_argument("--kind", action="append", choices=CASES)
    parser.add_argument("--command", action="append", choices=COMMANDS)
    parser.add_argument("--size", action="append", type=int)
    asked = parser.parse_args()
    with (asked.folder / "sizes.csv").open("a", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        if not file.tell():
            table.writerow(HEAD)
        kinds = asked.kind or list(CASES)
        for row in rows(kinds, asked.command or list(COMMANDS), asked.size or []):
            table.writerow(row)
            file.flush()


if __name__ == "__main__":
    main()
