"""An electronic Duffing oscillator (the Silverbox benchmark).

What each term of the equation buys, in mV of free-run error.

Run `python -m benchmarks.silverbox [FOLDER]`; it reads ../shared/data/silverbox/SNLS80mV.csv beside
the repository, fits on the multisine at the end of the record, tests on the arrow at its beginning,
which reaches larger amplitudes, prints a table and writes silverbox.csv and silverbox.png. `inside`
is the part of the arrow whose amplitudes the fit has seen.
"""

import csv
import sys
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from femnl.fits.record.oscillator import fit_oscillator, simulate_oscillator
from femnl.observe.record.free_run import Hold
from femnl.plot.style import COLOURS, new_figure, style

Array = NDArray[np.float64]
SAMPLING_RATE = 1e7 / 2**14
HEAD = {
    "seconds": "time (s)",
    "fitted_mV": "error where fitted (mV)",
    "held_out_mV": "held out (mV)",
    "held_out_within_fitted_range_mV": "held out, amplitudes as fitted (mV)",
    "frequency": "f₀ (Hz)",
    "quality_factor": "Q",
    "alpha": "α (V⁻²)",
}
# The record does not begin at rest: its unknown first state has decayed by e^-10 after 300 samples.
WINDOW = 400
TEST = slice(300, 40_000)
FITTED = slice(41_000, 130_000)
MODELS: tuple[tuple[str, tuple[str, ...], Hold], ...] = (
    ("linear, drive held between samples", (), "zero-order"),
    ("+ offset", ("offset",), "zero-order"),
    ("+ k₃ y³", ("offset", "cubic"), "zero-order"),
    ("linear, smooth drive", (), "band-limited"),
    ("+ offset", ("offset",), "band-limited"),
    ("+ k₃ y³", ("offset", "cubic"), "band-limited"),
    ("+ k₂ y²", ("offset", "cubic", "quadratic"), "band-limited"),
    ("+ η y² ẏ", ("offset", "cubic", "quadratic", "nonlinear_damping"), "band-limited"),
)


def record() -> tuple[Array, Array]:
    """Read drive and output [V]."""
    path = Path(__file__).parents[2] / "shared" / "data" / "silverbox" / "SNLS80mV.csv"
    if not path.exists():
        sys.exit(
            "silverbox: ../shared/data/silverbox/SNLS80mV.csv is not beside the repository; put "
            "the benchmark's record there"
        )
    columns = np.genfromtxt(path, delimiter=",", skip_header=1, usecols=(0, 1))
    return columns[:, 0], columns[:, 1]


def main() -> None:
    """Fit all models and write the table and the picture."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    folder.mkdir(parents=True, exist_ok=True)
    drive, output = record()
    rows: list[dict[str, str | float]] = []
    errors = {}
    for name, terms, hold in MODELS:
        begin = time.perf_counter()
        fit = fit_oscillator(drive, output, SAMPLING_RATE, terms, hold=hold, fitted=FITTED)
        seconds = time.perf_counter() - begin
        error = simulate_oscillator(fit, drive, SAMPLING_RATE, hold=hold) - output
        errors[name, hold] = error
        row: dict[str, str | float] = {"model": name, "drive": hold, "seconds": seconds}
        row |= {
            key: 1e3 * float(np.sqrt(np.mean(error[part] ** 2)))
            for key, part in (("fitted_mV", FITTED), ("held_out_mV", TEST))
        }
        row["held_out_within_fitted_range_mV"] = 1e3 * float(
            np.sqrt(np.mean(error[300:30_000] ** 2))
        )
        rows.append(
            row
            | {
                key: fit.parameters[key].value
                for key in ("frequency", "quality_factor", "alpha")
                if key in fit.parameters
            }
        )
    keys = dict.fromkeys(key for row in rows for key in row)
    with (folder / "silverbox.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, keys)
        writer.writerow({key: HEAD.get(key, key) for key in keys})
        writer.writerows(rows)
    lines = [f"{'model':36}{'drive':14}{'fitted':>10}{'held out':>10}{'inside':>10}{'time':>8}"]
    lines += [
        f"{row['model']:36}{row['drive']:14}{row['fitted_mV']:7.3f} mV{row['held_out_mV']:7.3f} mV"
        f"{row['held_out_within_fitted_range_mV']:7.3f} mV{row['seconds']:6.1f} s"
        for row in rows
    ]
    sys.stdout.write("\n".join([*lines, ""]))
    draw(folder / "silverbox.png", output, errors)


def draw(path: Path, output: Array, errors: dict[tuple[str, Hold], Array]) -> None:
    """Draw the arrow and the running error of some models below it."""
    shown: list[tuple[str, str, Hold, str]] = [
        ("linear + offset", "+ offset", "band-limited", COLOURS[4]),
        ("+ k₃ y³, drive held between samples", "+ k₃ y³", "zero-order", COLOURS[3]),
        ("+ k₃ y³", "+ k₃ y³", "band-limited", COLOURS[0]),
        ("+ k₃ y³ + k₂ y² + η y² ẏ", "+ η y² ẏ", "band-limited", COLOURS[1]),
    ]
    time_of = np.arange(TEST.stop) / SAMPLING_RATE
    with style():
        figure = new_figure(height=4.2)
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=[1, 2])
        top.plot(time_of, output[: TEST.stop], lw=0.4)
        top.set_ylabel("output (V)")
        for label, name, hold, colour in shown:
            running = np.sqrt(uniform_filter1d(errors[name, hold][: TEST.stop] ** 2, WINDOW))
            bottom.plot(time_of, 1e3 * running, color=colour, label=label)
        bottom.set(
            yscale="log",
            ylabel="running r.m.s. error (mV)",
            xlabel="time (s)",
            xlim=(0, time_of[-1]),
            ylim=(0.1, 100),
        )
        bottom.legend(ncols=2, loc="upper left")
        figure.savefig(path)


if __name__ == "__main__":
    main()
