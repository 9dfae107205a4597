"""Odd devices on chips, by the causes of spectra: `python -m tests.blind.odd_devices FOLDER`.

A chip has twelve square membranes that are alike to a spread, and one with a hidden cause, whose
spectrum the laboratory makes by laws of its own. Modes of one device scatter by more than the
instrument tells. The rates say how often the fit of the chip names the device, and its diagnosis
the cause. Of the devices with nothing hidden but another stress no cause is right.
"""

from typing import Any

import numpy as np

from femnl.chip import fit_chip
from femnl.chip.members import Chip, Member, Number
from tests.blind.counts import Events, Record
from tests.blind.draws import study
from tests.blind.lab import KINDS
from tests.blind.lab.bench import sized

GEOMETRY = "square-270um"
CAUSES = (
    "added_mass",
    "aspect_ratio",
    "compliant_clamp",
    "frame_mode",
    "shear_stress",
    "stress_anisotropy",
    "tension_gradient",
    "yielding_edge",
)
OTHER_STRESS = "other stress"
ORDINARY = 12
ODD = "odd"
SPREAD = (1e-4, 1e-3)
"""Relative spread of the frequencies from device to device."""
SCATTER = (1e-5, 5e-5)
"""The same from mode to mode of one device, beside what all its modes share."""
STRENGTH = (30.0, 1000.0)
"""σ of the scatter by which a cause stands out, uniform in the logarithm as the two above."""
TOLD = 1.0
"""Error [Hz] that the instrument tells."""
NOWHERE = (np.nan, np.nan)
STANDS_OUT = 6.0
"""Spreads by which a mode has to be off for a device to be odd."""


def make(seed: int) -> tuple[Chip, dict[str, Any]]:
    """Draw a chip, and return it with what is hidden."""
    rng = np.random.default_rng(seed)
    cause = str(rng.choice([*CAUSES, OTHER_STRESS]))
    spread, scatter, wanted = (
        float(np.exp(rng.uniform(*np.log(span)))) for span in (SPREAD, SCATTER, STRENGTH)
    )
    hidden = () if cause == OTHER_STRESS else (cause,)
    bench = KINDS["spectrum"].setup(GEOMETRY, hidden, rng)
    base = bench.draw(rng)
    plain = bench.measured(base, {}, rng)["spectrum"]
    bench.sd = scatter * float(plain["frequency"].mean())
    values: dict[str, dict[str, float]] = {}
    sigma = wanted
    if hidden:
        drawn = {cause: KINDS["spectrum"].CAUSES[cause](rng, bench)}
        causes, sizes = sized(bench, base, drawn, {cause: wanted})
        values = {name: one.values for name, one in causes.items()}
        sigma = sizes[cause]
    count = int(rng.integers(4, len(plain["frequency"]) + 1))
    members = []
    frequency: dict[str, dict[str, float]] = {}
    for k in range(ORDINARY + 1):
        own = k == ORDINARY
        lines = bench.measured(base, values if own else {}, rng)["spectrum"]
        shift = np.exp(spread * rng.standard_normal())
        if own and not hidden:
            shift *= 1 + spread * wanted * rng.choice([-1, 1]) / 10
        found = (lines["frequency"].values * shift)[:count]
        name = ODD if own else f"D{k}"
        frequency[name] = dict(
            zip(map(str, lines["label"].values[:count]), map(float, found), strict=True)
        )
        numbers = {mode: Number(value, TOLD) for mode, value in frequency[name].items()}
        members.append(Member(name, "square", NOWHERE, numbers, {}))
    chip = Chip(f"simulated {seed}", tuple(members), {"square": GEOMETRY}, ())
    truth = {
        "cause": cause,
        "sigma": sigma,
        "stands_out": _stands_out(frequency, float(np.hypot(spread, scatter))),
        "modes": count,
    }
    return chip, truth


def _stands_out(frequency: dict[str, dict[str, float]], spread: float) -> float:
    """Return by how many spreads the odd device is off in the mode where it is most."""
    away = []
    for mode, value in frequency[ODD].items():
        others = [own[mode] for name, own in frequency.items() if name != ODD and mode in own]
        if others:
            away.append(abs(np.log(value / np.exp(np.mean(np.log(others))))))
    return float(max(away, default=0.0) / spread)


def judge(seed: int) -> Record:
    """Fit a chip and say what was found of what is hidden."""
    chip, truth = make(seed)
    fit = fit_chip(chip)
    named = {cause.device: cause.name for cause in fit.causes}
    words = {cause.device: cause.words for cause in fit.causes}
    return {"seed": seed, **truth, "named": named, "words": words.get(ODD, "")}


TARGETS: dict[str, tuple[str, float]] = {
    "odd device named": ("at least", 0.97),
    "an ordinary device named": ("at most", 0.02),
}
"""What is asked of some rates."""


def score(records: list[Record]) -> dict[str, Any]:
    """Return the rates with 95 % intervals, and those of single causes."""
    events = Events()
    for r in records:
        odd = r["stands_out"] >= STANDS_OUT
        told = r["named"].get(ODD, "")
        causes = [name for name in told.split(" + ") if name in CAUSES]
        if odd:
            events.count("odd device named", r["cause"], bool(told))
        events.count(
            "an ordinary device named", r["cause"], any(name != ODD for name in r["named"])
        )
        if r["cause"] == OTHER_STRESS:
            events.count("other stress given no cause", r["cause"], not causes)
            continue
        alike = r["cause"] in told.split(" + ") or f"{r['cause']}," in r["words"]
        alike = alike or f"{r['cause']} may do the same" in r["words"]
        if odd:
            events.count("cause named, or among its equals", r["cause"], alike)
        events.count("wrong cause named", r["cause"], bool(causes) and not alike)
    return events.rates(TARGETS)


if __name__ == "__main__":
    study("odd devices on simulated chips", judge, score, 100)
