"""The film that all designs of a chip share, where their geometries are known."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from femnl.chip.hierarchy import MEAN_SD, Hierarchy, hierarchy
from femnl.chip.members import Chip
from femnl.chip.outliers import Cleaned
from femnl.chip.result import FilmFit
from femnl.chip.values import Array, Values
from femnl.core.device import Model
from femnl.core.errors import ParameterError
from femnl.core.fit import Parameter
from femnl.core.outline import Outline
from femnl.device.geometry import load
from femnl.device.geometry.curves import area, polyline
from femnl.fits.spectrum.labels import named_modes
from femnl.fits.spectrum.pose import BENDING_SD
from femnl.observe.film import SimulatedFilm

if TYPE_CHECKING:
    from femnl.chip.fit import Entries

MODES = 16
"""Modes of each design that are solved; labels beyond them are refused."""
EDGE_SD = 50e-9
"""Prior standard deviation [m] of how far an edge moves inwards: a ledge of silica of some µm, the
film on it and the chip move by tens of nanometres (docs/explanation/edges.md)."""
SIDES = np.array([50e-6, 100e-6, 200e-6, 500e-6, 1e-3])
"""Sides [m] of squares that are proposed as a further measurement."""
MISFITS = np.geomspace(0.3, 100.0, 8)
"""Standard deviation of what the simulation misses of a design, in units of the spread; the least
is none to speak of."""
CAUSES = ("edge moves inwards", "bending")


def fit_film(chip: Chip, entries: Entries, cleaned: Cleaned) -> FilmFit:
    """Fit one film to all designs.

    The mean of design and mode g is that of its simulation, ln f_g, with

        ln f_g + δ + d·s_g + b·β_g + ε_g,

    δ: of the speed of waves. d: by how far every edge moves inwards after release, with
    s = −E P/(4(1 − ν) σ A) of the areal strain that this releases, P/A the perimeter over the area
    (for a square of side L: −E d/((1 − ν) σ L)). b: of the logarithm of the bending length, β the
    part of a mode's energy in bending. ε: what the simulation misses, of unknown size. The edge
    is taken as ½(1 − β) ln(1 + 2 s d), exactly, about where the data put it. Uneven tension that it
    leaves near corners is not in it.
    """
    films = _films(chip)
    design = _columns(entries, films)
    # Films without a bending length have no other one
    tried = (0, 1) if design.bending.any() else (0,)
    sets = [s for n in range(len(tried) + 1) for s in combinations(tried, n)]
    fitted = {s: _fit_set(cleaned.model, design, s) for s in sets}
    total = logsumexp([one.log_evidence for one in fitted.values()])
    best = max(fitted.values(), key=lambda one: one.log_evidence)
    first = next(iter(films.values()))
    numbers = dict(best.numbers)
    offset, offset_sd = numbers.pop("δ")
    speed = first.speed * float(np.exp(offset))
    names = {CAUSES[0]: ("edge moves inwards", "m"), CAUSES[1]: ("ln(ℓ/ℓ of the geometry)", "1")}
    return FilmFit(
        {_name(s): float(np.exp(one.log_evidence - total)) for s, one in fitted.items()},
        (
            Parameter("speed of waves", speed, speed * offset_sd, "m/s"),
            *(Parameter(names[c][0], *number, names[c][1]) for c, number in numbers.items()),
        ),
        _residuals(best, entries),
        _measure_next(first.model, design.slackening, cleaned.model, numbers),
    )


@dataclass(frozen=True)
class Design:
    """What simulation says of each group: ln f, (groups,), and both columns, (groups,) each.

    slackening: s [1/m] of `slackening`. bending: part of the energy in bending.
    """

    base: Array
    slackening: Array
    bending: Array

    def about(self, shift: float, offset: float) -> tuple[Array, Array]:
        """Return ln f and the columns, (groups, 2), for an edge that has moved by a shift [m].

        ln f + ½(1 − β) ln(1 + 2 s d/e^{2δ}) is taken as linear about d; e^{2δ} is the film's stress
        over that of the geometry, and β counts that ℓ ∝ σ^{−1/2}.
        """
        s = self.slackening * np.exp(-2 * offset)
        left = 1 + 2 * s * shift
        edge = (1 - self.bending) * s / left
        base = self.base + 0.5 * (1 - self.bending) * np.log(left) - edge * shift
        return base, np.array([edge, self.bending]).T


@dataclass(frozen=True)
class FittedSet:
    """A set of causes, fitted. models: one for each size of what the simulation misses.

    numbers: mean and standard deviation of δ and of each cause. columns: ∂ ln f of each group by
    the strength of each of `CAUSES`, (groups, 2).
    """

    models: list[Hierarchy]
    numbers: dict[str, tuple[float, float]]
    columns: Array

    @property
    def log_evidence(self) -> float:
        """Log evidence, all sizes of the misfit alike probable."""
        return float(logsumexp([m.log_evidence for m in self.models]) - np.log(len(self.models)))


MOST_LINEARISATIONS = 8
"""Linearisations of the edge at most; three are enough where it moves by tens of nanometres."""
SLACK = 0.9
"""Largest part of the stress that an edge is taken to have released in a linearisation."""


def _fit_set(chip: Hierarchy, design: Design, some: tuple[int, ...]) -> FittedSet:
    v = chip.values
    shift = offset = 0.0
    for _ in range(MOST_LINEARISATIONS if 0 in some else 1):
        base, columns = design.about(shift, offset)
        values = Values(v.y - base[v.group], v.sd, v.device, v.group, v.place)
        models = [_model(values, chip.unit, columns, some, m * chip.unit) for m in MISFITS]
        numbers = _parameters(models, some)
        furthest = SLACK / (2 * np.abs(design.slackening).max()) * np.exp(2 * numbers["δ"][0])
        found = float(np.clip(numbers.get(CAUSES[0], (0.0, 0.0))[0], -furthest, furthest))
        settled = abs(found - shift) < SETTLED * EDGE_SD
        shift, offset = found, numbers["δ"][0]
        if settled:
            break
    return FittedSet(models, numbers, columns)


SETTLED = 1e-4
"""Change of the edge, in its prior standard deviation, below which it is settled."""


def _name(some: tuple[int, ...]) -> str:
    return " + ".join(CAUSES[k] for k in some) or "one film as simulated"


def _films(chip: Chip) -> dict[str, SimulatedFilm]:
    """Return the simulated film of every design.

    Raises: ParameterError where a design has no geometry, or their films differ.
    """
    designs = sorted({m.design for m in chip.members})
    lacking = [d for d in designs if d not in chip.geometries]
    if lacking:
        raise ParameterError(
            f"chip {chip.name}: design {lacking[0]} has no geometry; add [design.{lacking[0]}], "
            "or leave out all geometries"
        )
    films = {d: SimulatedFilm.of_one_material(load(chip.geometries[d]), MODES) for d in designs}
    first = films[designs[0]].model.film
    for design in designs:
        if films[design].model.film != first:
            raise ParameterError(
                f"chip {chip.name}: designs {designs[0]} and {design} have different films; "
                "devices of a chip share one"
            )
    return films


def _columns(entries: Entries, films: dict[str, SimulatedFilm]) -> Design:
    """Return ln f of each group by simulation, and what each cause changes of it."""
    base = np.empty(len(entries.groups))
    columns = np.empty((len(entries.groups), len(CAUSES)))
    for design, film in films.items():
        own = [k for k, group in enumerate(entries.groups) if group[0] == design]
        order = _order(tuple(entries.groups[k][1] for k in own), film)
        base[own] = np.log(film.modes.frequency[order])
        columns[own, 0] = slackening(film.model)
        # A membrane stores nothing in bending, though `SimulatedFilm` says 1 of it
        columns[own, 1] = film.bending_share[order] if film.model.bending else 0.0
    return Design(base, *columns.T)


def _order(modes: tuple[str, ...], film: SimulatedFilm) -> NDArray[np.int64]:
    """Return which simulated modes names mean: labels "m,n", or numbers from 1 on."""
    if all(mode.isdecimal() and 0 < int(mode) <= MODES for mode in modes):
        return np.array([int(mode) - 1 for mode in modes])
    return named_modes(modes, film).order


def slackening(model: Model) -> float:
    """Return −E P/(4(1 − ν) σ A) [1/m]: ∂ ln f/∂d for edges that move inwards by d all around."""
    film = model.film
    around, inside = _around(model.outline)
    return -film.young * around / (4 * (1 - film.poisson) * film.stress * inside)


def _around(outline: Outline) -> tuple[float, float]:
    """Return perimeter [m] and area [m²] of an outline, holes not counted."""
    loop = polyline(outline)
    return float(np.linalg.norm(np.diff(loop, axis=0), axis=1).sum()), abs(area(outline))


PRIORS = (EDGE_SD, BENDING_SD)
"""Prior standard deviations of the strengths of `CAUSES`."""


def _model(
    values: Values, unit: float, columns: Array, some: tuple[int, ...], misfit: float
) -> Hierarchy:
    """Return the model whose means are δ, the causes of a set, and what the simulation misses."""
    count = len(columns)
    factors = [np.full((count, 1), MEAN_SD * unit)]
    factors += [PRIORS[k] * columns[:, [k]] for k in some]
    return hierarchy(values, unit, np.hstack([*factors, misfit * np.eye(count)]))


def _parameters(models: list[Hierarchy], some: tuple[int, ...]) -> dict[str, tuple[float, float]]:
    """Return mean and standard deviation of δ and of the strength of each cause of a set."""
    evidence = np.array([m.log_evidence for m in models])
    weights = np.exp(evidence - logsumexp(evidence))
    sds = [MEAN_SD * models[0].unit, *(PRIORS[k] for k in some)]
    # The first features are these numbers in their prior standard deviations
    features = np.eye(models[0].prior_sd.shape[1])[: len(sds)]
    each = [m.expected(features) for m in models]
    means = weights @ np.array([one.mean for one in each])
    squares = weights @ np.array([one.sd**2 + one.mean**2 for one in each])
    errors = np.sqrt(np.maximum(squares - means**2, 0.0))
    found = {
        name: (float(sd * mean), float(sd * error))
        for name, sd, mean, error in zip(
            ["δ", *(CAUSES[k] for k in some)], sds, means, errors, strict=True
        )
    }
    middle = float(np.median(models[0].values.y))
    found["δ"] = (found["δ"][0] + middle, found["δ"][1])
    return found


def _residuals(fitted: FittedSet, entries: Entries) -> dict[str, float]:
    """Return ln(mean/film) of every design and mode, the film with the causes of the set."""
    # The simulation of one film is subtracted from the values of these models already
    values = fitted.models[0].values
    strengths = np.array([fitted.numbers.get(cause, (0.0, 0.0))[0] for cause in CAUSES])
    film = fitted.numbers["δ"][0] + fitted.columns @ strengths
    return {
        " ".join(entries.groups[k]): float(np.mean(values.y[values.group == k]) - film[k])
        for k in values.groups
    }


def _measure_next(
    model: Model, present: Array, chip: Hierarchy, numbers: dict[str, tuple[float, float]]
) -> str:
    """Return which square beside the chip's devices would tell how far edges move.

    The strain that they release is ∝ 1/L, a common film is not; so the square furthest in 1/L from
    the mean of the present designs.

    Args:
        model: one of the designs, for the film.
        present: `slackening` of each group [1/m].
        chip: for the spread.
        numbers: of the leading set.
    """
    film = model.film
    own = float(present.mean())
    per_metre = -film.young / ((1 - film.poisson) * film.stress) / SIDES
    spread = chip.spread()[0]
    known = numbers.get(CAUSES[0], (0.0, EDGE_SD))[1]
    best = int(np.argmax(np.abs(per_metre - own)))
    shift = abs(per_metre[best] - own) * known
    times = f"{shift / spread:.0f}" if shift >= 10 * spread else f"{shift / spread:.2g}"
    return (
        f"a square of {SIDES[best] * 1e6:.0f} µm on this chip: edges that move inwards by another "
        f"{known * 1e9:.2g} nm, which these data leave open, would shift it by "
        f"{100 * shift:.2g} % against the present devices, {times} times the spread from device to "
        "device"
    )
