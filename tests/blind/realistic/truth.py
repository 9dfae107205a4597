"""What is true of a file without noise: what is left of it, and the share of each cause.

The excess E of a set of causes is the least |data − model|² [σ²] over the base parameters and the
values of these causes, of the laboratory's own first laws. Least is found by Gauss–Newton steps
from the truth. For the hidden set S,

    share(c) = (E(S without c) − E(S))/E(none),

which is what Diagnosis 1.1 asks of held-out χ², without noise and without the cost of parameters.
Where the base model takes up nothing and one cause stands beside an unknown of 1/q of its size,
share = 1/(1 + 1/q²), and where its law is the first, and nothing is unknown, share = 1.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.blind.lab.bench import FARTHEST, INEXACT, STEP, Array, Bench, Values
from tests.blind.lab.laws import first

Hidden = dict[str, Values]
CHANGE = 1e3
"""Parts of itself that one unit of a value of a cause is, so that steps for tangents show."""
LEAST = 0.1
MOST = 10.0
"""Factors within which a value of a cause is moved."""
POSITIVE = frozenset(
    ("speed", "bending", "loss", "frequency", "quality_factor", "linewidth", "peak", "stiffness")
)
"""Base parameters without which there is no device."""
KEPT = 0.98
"""Part of the data that must count as before where a fit is better."""
CLOSE = 1e-3
"""Relative change of E that ends the steps."""
STEPS = 4
"""Gauss–Newton steps from the truth."""
FIRM = 1e-3
"""Part of the strongest direction of tangents that is followed; weaker ones lead astray."""
ROUNDS = 3
NEAR = 0.2
FAINT = 1e-9
"""Steps to a wanted deviation, the logarithm that is near enough, and one that is none."""
SLIGHT = 1e-7
"""Part below which a direction does not show at all."""


def excess(
    bench: Bench,
    base: Values,
    hidden: Hidden,
    free: tuple[str, ...],
    more: Array | float = 0.0,
    steps: int = STEPS,
) -> float:
    """Return E of the causes in `free` for data of `hidden` and of what is unknown, [σ²]."""
    left, _ = residual(bench, base, hidden, free, more, steps)
    return float(left @ left)


def residual(
    bench: Bench,
    base: Values,
    hidden: Hidden,
    free: tuple[str, ...],
    more: Array | float = 0.0,
    steps: int = STEPS,
) -> tuple[Array, Callable[[Array], Array]]:
    """Return what is left of the data [σ], and what takes off a signal all that tangents span.

    steps: after the one from the truth, which is to first order.
    """
    own = {name: first(hidden[name]) for name in free}
    specs = [(name, spec) for name, values in own.items() for spec in values]
    place = np.zeros(len(bench.unit) + len(specs))
    best = _linear(bench, base, hidden, _variants(bench, base, own, specs, place), more)
    step = best.step
    for _ in range(steps):
        if float(np.abs(step).max(initial=0.0)) < STEP**2:
            break
        tried = np.clip(place + step, -FARTHEST, FARTHEST)
        found = _linear(bench, base, hidden, _variants(bench, base, own, specs, tried), more)
        settled = found.size > (1 - CLOSE) * best.size
        # Fewer data, where others jump or do not exist, are no better fit
        if found.seen >= KEPT * best.seen and found.size < best.size:
            place = tried
            best = found
            step = found.step
        else:
            step = step / 4
        if settled and found.size < (1 + CLOSE) * best.size:
            break
    return best.left, _off(best.spanned)


@dataclass(frozen=True)
class Linear:
    """Data less a model and what its tangents span, the step to there, and how many data count."""

    left: Array
    spanned: Array
    step: Array
    seen: int

    @property
    def size(self) -> float:
        """Return E in the end of the step, to first order."""
        return float(self.left @ self.left)


def _linear(
    bench: Bench, base: Values, hidden: Hidden, moved: list[tuple[Values, Hidden]], more: Any
) -> Linear:
    rows = bench.clean([(base, hidden), *moved])
    # What jumps in one of them is left out of all; it tells nothing to first order
    seen = np.isfinite(rows).all(axis=0) & (rows[0] != 0)
    rows = np.where(seen, rows, 0.0)
    change = rows[0] - rows[1] + np.where(seen, more, 0.0)
    tangents = (rows[2:] - rows[1]).T / STEP
    size = np.linalg.norm(tangents, axis=0)
    # What is a choice, as a number of poles, has no tangent
    size = np.where(size > 0, size, 1.0)
    basis, strength, turn = np.linalg.svd(tangents / size, full_matrices=False)
    spanned = basis[:, strength > SLIGHT * strength[0]]
    firm = strength > FIRM * strength[0]
    step = (turn[firm] / strength[firm, None]).T @ (basis[:, firm].T @ change) / size
    return Linear(change - spanned @ (spanned.T @ change), spanned, step, int(seen.sum()))


def _variants(
    bench: Bench, base: Values, own: Hidden, specs: list[tuple[str, str]], place: Array
) -> list[tuple[Values, Hidden]]:
    """Return a model and those for its tangents."""
    steps = np.vstack([np.zeros(len(place)), STEP * np.eye(len(place))])
    return [_moved(bench, base, own, specs, place + step) for step in steps]


def _off(spanned: Array) -> Callable[[Array], Array]:
    def project(signal: Array) -> Array:
        return np.asarray(signal - spanned @ (spanned.T @ signal))

    return project


def _moved(
    bench: Bench, base: Values, own: Hidden, specs: list[tuple[str, str]], place: Array
) -> tuple[Values, Hidden]:
    """Return base and causes, moved by units of the base's and by parts of what the causes are."""
    near = base | {
        spec: base[spec] + float(by) * unit
        for (spec, unit), by in zip(bench.unit.items(), place, strict=False)
    }
    near |= {
        spec: max(near[spec], LEAST * base[spec]) for spec in POSITIVE.intersection(bench.unit)
    }
    beside = {name: dict(values) for name, values in own.items()}
    for (name, spec), by in zip(specs, place[len(bench.unit) :], strict=True):
        beside[name][spec] *= float(np.clip(1 + CHANGE * by, LEAST, MOST))
    return near, beside


def shares(
    bench: Bench, base: Values, hidden: Hidden, names: tuple[str, ...], more: Array | float = 0.0
) -> dict[str, dict[str, float]]:
    """Return the share of each cause in `names`, added to the others and alone, and what is left.

    left: √(E(names)/E(none)), what the first laws of all leave, in parts of what the base leaves.
    """
    ideal = set(hidden) == set(names) and not np.any(more)
    ideal = ideal and not any(INEXACT in values for values in hidden.values())
    if ideal and len(names) == 1:
        # The first law leaves nothing of itself
        return {names[0]: {"share": 1.0, "alone": 1.0, "left": 0.0}}
    whole = excess(bench, base, hidden, (), more)
    rest = excess(bench, base, hidden, names, more)
    found = {}
    for name in names:
        others = tuple(other for other in names if other != name)
        without = excess(bench, base, hidden, others, more) if others else whole
        alone = excess(bench, base, hidden, (name,), more) if others else rest
        found[name] = {
            "share": float((without - rest) / whole),
            "alone": float((whole - alone) / whole),
            "left": float(np.sqrt(rest / whole)),
        }
    return found


def bent(bench: Bench, base: Values, hidden: Hidden, wanted: float, most: float = 1.0) -> Hidden:
    """Return the hidden causes with second laws that leave the wanted part of them, or the most.

    To first order, by the secant in the logarithms, from a tenth of the most.
    """
    names = tuple(hidden)
    whole = excess(bench, base, hidden, (), steps=0)

    def by(much: float) -> Hidden:
        return {name: {**values, INEXACT: much} for name, values in hidden.items()}

    def leaves(much: float) -> float:
        return float(np.sqrt(excess(bench, base, by(much), names, steps=0) / whole))

    much = most / 10
    power = 1.0
    found = leaves(much)
    for _ in range(ROUNDS):
        if found < FAINT or abs(np.log(found / wanted)) < NEAR:
            break
        following = min(much * (wanted / found) ** (1 / power), most)
        if abs(np.log(following / much)) < NEAR / 10:
            break
        earlier = found
        found = leaves(following)
        if found > FAINT:
            power = float(np.log(found / earlier) / np.log(following / much))
            power = float(np.clip(power, 0.3, 3.0))
        much = following
    return by(much)
