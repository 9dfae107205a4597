"""Simulated chips: `python -m tests.blind.chips FOLDER --seed S --draws N`, from the top.

Every chip has designs, devices on a grid of which a part was made or measured, one to three modes
of each with a part missing, a variation over the chip (none, a plane, a bowl, a wave that is
neither), a spread, and what is hidden: nothing, devices that deviate by 5 to 100σ, or two devices
whose names were exchanged. σ is what an exact prediction of the device by the ordinary ones would
be wrong by, `_sigma`: of two devices of a design, no one can say which is the odd one. The rates
say how often the fit finds what is hidden.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from femnl.chip import fit_chip
from femnl.chip.members import Chip, Member, Number
from tests.blind.counts import Events, Record
from tests.blind.draws import study

SHAPES = ("none", "plane", "bowl", "wave")
HIDDEN = ("nothing", "one", "two", "exchanged", "lossy")
STRENGTH = (5.0, 100.0)
"""σ by which a device or a variation stands out, uniform in the logarithm."""
VARIES = 0.95
"""Probability of a variation from which on it counts as found."""
ORDINARY = 3
"""Devices of a design that stay ordinary, so that an odd one of it can be told."""


@dataclass(frozen=True)
class Truth:
    """What is true of a simulated chip."""

    shape: str
    strength: float
    hidden: str
    odd: dict[str, float]


def make(seed: int) -> tuple[Chip, Truth]:
    """Draw a chip.

    The strength of a variation is √Σ(its values less their means by design)²/spread.
    """
    rng = np.random.default_rng(seed)
    designs = int(rng.integers(1, 5))
    count = int(rng.integers(max(10, 5 * designs), 51))
    side = int(np.ceil(np.sqrt(count * 1.4)))
    grid = rng.permutation([(i, j) for i in range(side) for j in range(side)])[:count]
    place = grid - grid.mean(axis=0)
    design = np.sort(rng.integers(0, designs, count))
    design[: 2 * designs] = np.repeat(np.arange(designs), 2)
    rng.shuffle(design)
    spread = float(np.exp(rng.uniform(np.log(3e-4), np.log(2e-2))))
    shape = str(rng.choice(SHAPES))
    field = _field(shape, place / max(side, 1), rng)
    strength = 0.0
    if shape != "none":
        own = field.copy()
        for d in range(designs):
            own[design == d] -= own[design == d].mean()
        strength = float(np.exp(rng.uniform(*np.log(STRENGTH))))
        field = field * strength * spread / np.linalg.norm(own)
    shift = rng.normal(0, spread, count)
    hidden = str(rng.choice(HIDDEN))
    odd: dict[str, float] = {}
    loss = rng.normal(0, 0.4, count)
    where = _telling(design, rng)
    if hidden in ("one", "two"):
        chosen = where[: 1 if hidden == "one" else 2]
        for k in chosen:
            size = float(np.exp(rng.uniform(*np.log(STRENGTH))))
            # As large as wanted, whatever its own part of the spread is
            sigma = _sigma(int(k), chosen, design, place, field, spread)
            shift[k] = size * sigma * rng.choice([-1, 1])
            odd[str(k)] = size
    if hidden == "lossy":
        size = float(np.exp(rng.uniform(np.log(5), np.log(12))))
        loss[where[0]] = -0.4 * size
        odd[str(where[0])] = size
    told = [f"d{d}" for d in design]
    others = where[design[where] != design[where[0]]]
    if hidden == "exchanged" and len(others):
        first = int(where[0])
        second = int(others[0])
        told[first], told[second] = told[second], told[first]
        odd = {str(first): np.inf, str(second): np.inf}
    modes = int(rng.integers(1, 4))
    base = np.cumprod(1 + rng.uniform(0.1, 0.6, designs)) * 1e5
    ratio = np.cumprod(np.concatenate([[1.0], 1 + rng.uniform(0.3, 0.6, modes - 1)]))
    sd = spread * float(rng.uniform(0.01, 0.3))
    members = []
    for k in range(count):
        kept = [m for m in range(modes) if m == 0 or rng.random() > 0.3]
        frequency = {}
        for m in kept:
            clean = base[design[k]] * ratio[m] * np.exp(field[k] + shift[k])
            own = clean * np.exp(rng.normal(0, 0.2 * spread) + rng.normal(0, sd))
            frequency[str(m + 1)] = Number(float(own), float(sd * own))
        quality = {"1": Number(float(1e6 * np.exp(loss[k])), float(3e4 * np.exp(loss[k])))}
        x, y = (float(c) for c in place[k])
        members.append(Member(str(k), told[k], (x, y), frequency, quality))
    return Chip(f"simulated {seed}", tuple(members), {}, ()), Truth(shape, strength, hidden, odd)


def _telling(design: np.ndarray[Any, Any], rng: np.random.Generator) -> np.ndarray[Any, Any]:
    """Return the devices that may be odd, in random order; each design keeps ordinary ones."""
    order = rng.permutation(len(design))
    kept = [k for d in np.unique(design) for k in order[design[order] == d][ORDINARY:]]
    return rng.permutation(np.array(kept, int))


def _sigma(
    device: int,
    odd: np.ndarray[Any, Any],
    design: np.ndarray[Any, Any],
    place: np.ndarray[Any, Any],
    field: np.ndarray[Any, Any],
    spread: float,
) -> float:
    """Return the standard deviation of ln f of a device, predicted by those that are not odd.

    By least squares of the means of all designs and, where there is a variation, a plane and a
    bowl; what those miss of the variation counts as spread.
    """
    x, y = place.T / np.ptp(place)
    terms = np.eye(design.max() + 1)[design]
    if field.any():
        terms = np.column_stack([terms, x, y, x**2, x * y, y**2])
    ordinary = np.setdiff1d(np.arange(len(design)), odd)
    weights, *_ = np.linalg.lstsq(terms[ordinary], field[ordinary], rcond=None)
    missed = field[ordinary] - terms[ordinary] @ weights
    own = np.linalg.lstsq(terms[ordinary].T, terms[device], rcond=None)[0]
    return float(np.sqrt((1 + own @ own) * (spread**2 + np.mean(missed**2))))


def _field(shape: str, place: np.ndarray[Any, Any], rng: np.random.Generator) -> Any:
    x, y = place.T
    turn = rng.uniform(0, 2 * np.pi)
    along = x * np.cos(turn) + y * np.sin(turn)
    if shape == "plane":
        return along
    if shape == "bowl":
        return x**2 + y**2 + 0.3 * along
    if shape == "wave":
        return np.sin(4 * along + rng.uniform(0, 2 * np.pi))
    return np.zeros(len(place))


def judge(seed: int) -> Record:
    """Fit a chip and say what was found of what is hidden."""
    chip, truth = make(seed)
    fit = fit_chip(chip)
    assert fit.quality is not None
    named = {c.device: c.name for c in fit.causes}
    devices = fit.frequency.devices
    held = [bool(abs(d.sigma) < 1) for d in devices if d.device not in truth.odd]
    return {
        "seed": seed,
        "shape": truth.shape,
        "strength": truth.strength,
        "hidden": truth.hidden,
        "odd": truth.odd,
        "named": named,
        "varies": fit.frequency.varies,
        "held": held,
        "error": fit.frequency.left_out.error,
        "plain": fit.frequency.left_out.plain_error,
    }


TARGETS: dict[str, tuple[str, float]] = {
    "hidden device named": ("at least", 0.97),
    "chip with nothing hidden: a device named": ("at most", 0.02),
    "variation of 5σ and more found": ("at least", 0.97),
    "variation found where there is none": ("at most", 0.02),
    "68 % intervals hold": ("within", 0.68),
}
"""What is asked of some rates."""


def score(records: list[Record]) -> dict[str, Any]:
    """Return the rates, with 95 % intervals, of all chips and by the form of their variation."""
    events = Events()
    for r in records:
        for device in r["odd"]:
            events.count("hidden device named", r["shape"], device in r["named"])
            if r["hidden"] == "exchanged":
                told = r["named"].get(device) == "mislabelled"
                events.count("exchanged names told", r["shape"], told)
        if not r["odd"]:
            events.count("chip with nothing hidden: a device named", r["shape"], bool(r["named"]))
        for device in r["named"]:
            events.count("device named that is none", r["shape"], device not in r["odd"])
        none = r["shape"] == "none"
        of_field = (
            "variation found where there is none" if none else "variation of 5σ and more found"
        )
        events.count(of_field, r["shape"], r["varies"] > VARIES)
        for held in r["held"]:
            events.count("68 % intervals hold", r["shape"], held)
        events.count(
            "worse than 1.05 of the design's mean", r["shape"], r["error"] > 1.05 * r["plain"]
        )
    return events.rates(TARGETS)


if __name__ == "__main__":
    study("simulated chips", judge, score, 300)
