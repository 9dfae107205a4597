"""What every kind of measurement of the laboratory gives, and how detectable a cause is in it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
import xarray as xr
from numpy.typing import NDArray

Array = NDArray[np.float64]
Values = dict[str, float]
STEP = 1e-6
"""Change of a base parameter, in parts of what it is worth, for a tangent."""
FARTHEST = 10.0
"""Units by which a base parameter may be moved: beyond, tangents say nothing and a film may not
exist.
"""
SHARE = 1e-3
"""Relative change of a strength of another cause for a tangent; what is no strength, as a place,
changes by STEP.
"""

BLIND = 1e-7
STEEP = 1e-3
"""Parts of the strongest direction of tangents below which one does not show, and below which it is
not followed.
"""
ROUNDS = 6
NEAR = 0.25
"""Rounds in which a cause is scaled to the wanted size, and the logarithm of the factor that is
near enough.
"""
FOLLOWED = 4
"""Steps along tangents that are taken to see what a cause leaves."""


INEXACT = "inexact"
"""Name of the value that says how far a cause is from its first law."""


class Noise(Protocol):
    """What a measurement takes its noise from, in σ."""

    def standard_normal(self, size: Any, /) -> Any:
        """Return noise of that shape."""
        ...


@dataclass(frozen=True)
class Cause:
    """A cause as drawn.

    Its values, which of them grow with its strength, and how much they may still grow.
    """

    values: Values
    strengths: tuple[str, ...]
    most: float = np.inf


class Bench(Protocol):
    """One measurement under way.

    unit: what each base parameter that an analysis would fit is worth.
    """

    unit: Values

    def draw(self, rng: np.random.Generator) -> Values:
        """Draw the base parameters."""
        ...

    def clean(self, variants: list[tuple[Values, dict[str, Values]]]) -> Array:
        """Data without noise for each base with each set of causes, in σ, (n_variants, n)."""
        ...

    def measured(
        self, base: Values, hidden: dict[str, Values], rng: Noise
    ) -> dict[str, xr.Dataset]:
        """Data with noise, as the instrument rounds them: the groups of a file."""
        ...


def scaled(cause: Cause, factor: float) -> Cause:
    """Return a cause whose strengths are larger by a factor, up to the most that is physical."""
    factor = min(factor, cause.most) if cause.strengths else 1.0
    values = {
        name: value * factor if name in cause.strengths else value
        for name, value in cause.values.items()
    }
    return replace(cause, values=values, most=cause.most / factor)


def sizes(
    bench: Bench, base: Values, hidden: dict[str, Cause], rounds: int = 0
) -> dict[str, float]:
    """Return at how many σ each cause is detectable.

    How far it moves the data beyond what base parameters and the other causes can make up for.

    To first order; with rounds, base and strengths are moved so many times along their tangents,
    and what that leaves counts if it is less.
    """
    whole = {name: cause.values for name, cause in hidden.items()}
    found = {}
    for name in hidden:
        rest = {k: values for k, values in whole.items() if k != name}
        specs = [(k, spec) for k, values in rest.items() for spec in values if spec != INEXACT]
        steps = np.array([-SHARE if spec in hidden[k].strengths else STEP for k, spec in specs])
        variants = [(base, whole), (base, rest)]
        variants += [
            (base | {spec: base[spec] + STEP * unit}, rest) for spec, unit in bench.unit.items()
        ]
        variants += [
            (base, rest | {k: rest[k] | {spec: rest[k][spec] * (1 + s)}})
            for (k, spec), s in zip(specs, steps, strict=True)
        ]
        rows = bench.clean(variants)
        tangents = rows[2:] - rows[1]
        length = np.maximum(np.linalg.norm(tangents, axis=1), 1e-300)
        basis, strength, turn = np.linalg.svd((tangents / length[:, None]).T, full_matrices=False)
        basis = basis[:, strength > BLIND * strength[0]]
        change = rows[0] - rows[1]
        left = [float(np.linalg.norm(change - basis @ (basis.T @ change)))]
        clear = strength > STEEP * strength[0]
        taken = np.zeros(len(tangents))
        back = (turn[clear] / strength[clear, None]).T / length[:, None]
        strong = np.array([spec in hidden[k].strengths for k, spec in specs], bool)
        alone = np.array([len(hidden[k].strengths) == 1 for k, spec in specs], bool)
        for _ in range(rounds):
            taken += back @ (basis[:, : len(back.T)].T @ change)
            moved = np.clip(STEP * taken, -FARTHEST, FARTHEST)
            near = base | {
                spec: base[spec] + s * unit
                for (spec, unit), s in zip(bench.unit.items(), moved, strict=False)
            }
            factors = np.clip(
                1 + steps * taken[len(bench.unit) :], np.where(alone, SHARE, -FARTHEST), FARTHEST
            )
            beside = {k: dict(values) for k, values in rest.items()}
            for (k, spec), factor in zip(specs, np.where(strong, factors, 1.0), strict=True):
                beside[k][spec] *= float(factor)
            change = rows[0] - bench.clean([(near, beside)])[0]
            # Tangents led where the laboratory's equations have no motion
            if not np.all(np.isfinite(change)):
                break
            left.append(float(np.linalg.norm(change)))
        found[name] = min(left)
    return found


def sized(
    bench: Bench, base: Values, hidden: dict[str, Cause], wanted: dict[str, float]
) -> tuple[dict[str, Cause], dict[str, float]]:
    """Scale every cause until it stands out by about the wanted σ, as far as is physical.

    Return them and their σ.
    """
    found = sizes(bench, base, hidden)
    power = dict.fromkeys(hidden, 1.0)
    for _ in range(ROUNDS):
        factor = {name: (wanted[name] / found[name]) ** (1 / power[name]) for name in hidden}
        factor = {
            name: min(f, hidden[name].most) if hidden[name].strengths else 1.0
            for name, f in factor.items()
        }
        if all(abs(np.log(f)) < NEAR for f in factor.values()):
            break
        before, earlier = hidden, found
        hidden = {name: scaled(cause, factor[name]) for name, cause in before.items()}
        found = sizes(bench, base, hidden)
        while not all(np.isfinite(size) for size in found.values()):
            # So strong that nothing is left to see
            factor = {name: f**0.5 for name, f in factor.items()}
            hidden = {name: scaled(cause, factor[name]) for name, cause in before.items()}
            found = sizes(bench, base, hidden)
        for name, f in factor.items():  # some effects are of second order in their strength
            if abs(np.log(f)) > NEAR:
                power[name] = float(
                    np.clip(np.log(found[name] / earlier[name]) / np.log(f), 0.5, 3.0)
                )
    return hidden, sizes(bench, base, hidden, FOLLOWED)


def sign(rng: np.random.Generator) -> float:
    """Draw +1 or −1."""
    return float(rng.choice([-1.0, 1.0]))


def one(spec: str, size: float, most: float) -> Callable[[np.random.Generator, Bench], Cause]:
    """Draw a cause of one strength, of this size before it is scaled."""
    return lambda rng, bench: Cause({spec: size}, (spec,), most)


def vector(
    specs: tuple[str, ...], size: float, most: float
) -> Callable[[np.random.Generator, Bench], Cause]:
    """Draw a cause of several strengths, of this size in all, in any direction."""

    def draw(rng: np.random.Generator, bench: Bench) -> Cause:
        direction = rng.standard_normal(len(specs))
        direction = size * direction / np.linalg.norm(direction)
        return Cause(dict(zip(specs, map(float, direction), strict=True)), specs, most)

    return draw
