"""Sweeps of linear modes, with a leak or without: `python -m tests.blind.linear_sweeps FOLDER`.

The laboratory of driven sweeps bends every resonance by several linewidths. Most real ones bend by
less than the noise shows, and their Q, noise and span differ by decades. The whole balance of a
driven oscillator makes them, which no slow flow has to follow.
"""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from femnl.diagnose import diagnose
from femnl.io import measurement
from tests.blind.counts import Events, Record
from tests.blind.draws import study

GEOMETRY = "square-270um"
LEAK = "crosstalk"
RANGES = {
    "frequency": (1e4, 3e6),
    "quality": (30.0, 1e6),
    "span": (4.0, 40.0),
    "height": (1e-3, 1.0),
    "signal to noise": (30.0, 1e5),
    "leak": (0.05, 5.0),
}
"""Hz; 1; linewidths; V/V; of the strongest drive; in parts of the height. All are uniform in the
logarithm.
"""
DRIVES = (0.02, 1.0)
MOST_DRIVES = 4
POINTS = (40, 300)


def make(seed: int) -> tuple[xr.Dataset, dict[str, Any]]:
    """Draw sweeps, and return them with what they are of."""
    rng = np.random.default_rng(seed)
    drawn = {name: float(np.exp(rng.uniform(*np.log(bounds)))) for name, bounds in RANGES.items()}
    cause = str(rng.choice(["", LEAK]))
    low, high = np.log(DRIVES)
    drives = np.sort(np.exp(rng.uniform(low, high, rng.integers(1, MOST_DRIVES + 1))))
    both_ways = rng.uniform() < 0.5
    if both_ways:
        drives = np.repeat(drives, 2)
    f0 = drawn["frequency"]
    width = f0 / drawn["quality"]
    half = drawn["span"] / 2
    away = np.linspace(-half, half, rng.integers(*POINTS)) + rng.uniform(-0.5, 0.5)
    f = f0 + width * away
    turn, leak_turn = np.exp(1j * rng.uniform(-np.pi, np.pi, 2))
    resonance = turn * 1j * f0 * width / (f0**2 - f**2 + 1j * f * width)
    leak = leak_turn * drawn["leak"] if cause else 0.0
    clear = drawn["height"] * (resonance + leak)
    sd = drawn["height"] * drives.max() / drawn["signal to noise"]
    noise = sd * rng.standard_normal((2, len(drives), len(f)))
    sweeps = measurement.response(
        np.broadcast_to(f, noise.shape[1:]),
        drives[:, None] * clear + noise[0] + 1j * noise[1],
        noise_sd=sd,
        mode="1,1",
        drive=drives,
        direction=np.tile([1.0, -1.0], len(drives))[: len(drives)],
    )
    return sweeps, {"cause": cause, "sweeps": len(drives), "points": len(f), **drawn}


def judge(seed: int) -> Record:
    """Diagnose sweeps and say what was found."""
    sweeps, truth = make(seed)
    with tempfile.TemporaryDirectory() as room:
        path = Path(room) / "sweeps.nc"
        measurement.write(measurement.bundle({"sweeps": sweeps}, geometry=GEOMETRY), path)
        found = diagnose(path)
    equals = [other.causes for other in found.alternatives] if found.verdict == "ambiguous" else []
    named = [list(causes) for causes in {found.causes, *equals} if causes]
    return {"seed": seed, **truth, "verdict": found.verdict, "named": sorted(named)}


TARGETS: dict[str, tuple[str, float]] = {
    "nothing hidden: adequate": ("at least", 0.98),
    "leak named, or among its equals": ("at least", 0.95),
    "wrong cause named": ("at most", 0.01),
}
"""What is asked of the rates."""


def score(records: list[Record]) -> dict[str, Any]:
    """Return the rates with 95 % intervals, and those of lone sweeps and of several."""
    events = Events()
    for r in records:
        kind = "one sweep" if r["sweeps"] == 1 else "several sweeps"
        if not r["cause"]:
            events.count("nothing hidden: adequate", kind, r["verdict"] == "adequate")
            continue
        right = [LEAK] in r["named"]
        events.count("leak named, or among its equals", kind, right)
        events.count("wrong cause named", kind, bool(r["named"]) and not right)
    return events.rates(TARGETS)


if __name__ == "__main__":
    study("sweeps of linear modes", judge, score, 100)
