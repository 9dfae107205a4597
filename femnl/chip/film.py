"""The film that all designs of a chip share, where their geometries are known."""

from __future__ import annotations

from functools import partial
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from femnl.chip.hierarchy import FLAT, Array, Hierarchy, Scale, Values, hierarchy
from femnl.chip.outliers import Cleaned
from femnl.chip.result import FilmFit
from femnl.chip.study import Chip
from femnl.core.device import Model, Outline
from femnl.core.errors import ParameterError
from femnl.core.fit import Parameter
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
LADDER = np.array([50e-6, 100e-6, 200e-6, 500e-6, 1e-3])
"""Sides [m] of squares that are proposed as a further measurement."""
MISFIT = np.geomspace(0.3, 100.0, 8)
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
    part of a mode's energy in bending. ε: what the simulation misses, of unknown size.
    """
    films = _films(chip)
    base, columns = _columns(entries, films)
    values = cleaned.model.values
    shifted = Values(
        values.y - base[values.group], values.sd, values.device, values.group, values.place
    )
    unit = cleaned.model.unit
    sets = [s for n in range(len(CAUSES) + 1) for s in combinations(range(len(CAUSES)), n)]
    models = {s: [_model(shifted, unit, columns, s, m * unit) for m in MISFIT] for s in sets}
    evidence = {s: float(logsumexp([m.log_evidence for m in each])) for s, each in models.items()}
    total = logsumexp([*evidence.values()])
    best = max(sets, key=lambda s: evidence[s])
    numbers = _parameters(models[best], columns, best)
    speed = next(iter(films.values())).speed
    offset = numbers.pop("δ")
    parameters = [
        Parameter("speed of waves", speed * np.exp(offset[0]), speed * offset[1], "m/s"),
    ]
    names = {0: ("edge moves inwards", "m"), 1: ("logarithm of the bending length", "1")}
    parameters += [Parameter(names[k][0], *numbers[CAUSES[k]], names[k][1]) for k in best]
    return FilmFit(
        {_name(s): float(np.exp(evidence[s] - total)) for s in sets},
        tuple(parameters),
        _residuals(models[best], entries, columns, best, offset[0], numbers),
        _measure_next(next(iter(films.values())).model, cleaned.model, best, numbers),
    )


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
    films = {d: SimulatedFilm(load(chip.geometries[d]), MODES) for d in designs}
    first = films[designs[0]].model.film
    for design in designs:
        if films[design].model.film != first:
            raise ParameterError(
                f"chip {chip.name}: designs {designs[0]} and {design} have different films; "
                "devices of a chip share one"
            )
    return films


def _columns(entries: Entries, films: dict[str, SimulatedFilm]) -> tuple[Array, Array]:
    """Return ln f of each group by simulation, and what each cause changes of it, (groups, 2)."""
    base = np.empty(len(entries.groups))
    columns = np.empty((len(entries.groups), len(CAUSES)))
    for design, film in films.items():
        own = [k for k, group in enumerate(entries.groups) if group[0] == design]
        order = _order(tuple(entries.groups[k][1] for k in own), film)
        base[own] = np.log(film.modes.frequency[order])
        columns[own, 0] = slackening(film.model)
        columns[own, 1] = film.bending_share[order]
    return base, columns


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


def _model(
    values: Values, unit: float, columns: Array, some: tuple[int, ...], misfit: float
) -> Hierarchy:
    priors = (EDGE_SD, BENDING_SD)
    count = len(columns)
    between = (FLAT * unit) ** 2 * np.ones((count, count)) + misfit**2 * np.eye(count)
    for k in some:
        between += priors[k] ** 2 * np.outer(columns[:, k], columns[:, k])
    return hierarchy(values, unit, between)


def _parameters(
    models: list[Hierarchy], columns: Array, some: tuple[int, ...]
) -> dict[str, tuple[float, float]]:
    """Return mean and standard deviation of δ and of the strength of each cause of a set."""
    weights = np.array([m.log_evidence for m in models])
    weights = np.exp(weights - logsumexp(weights))
    priors = {"δ": (FLAT * models[0].unit, np.ones(len(columns)))}
    sds = (EDGE_SD, BENDING_SD)
    priors |= {CAUSES[k]: (sds[k], columns[:, k]) for k in some}
    found = {}
    for name, (sd, column) in priors.items():
        means, squares = [], []
        for model in models:
            cross = sd**2 * column[model.values.group][None]
            one = model.expected(partial(_same_at_all_scales, cross, np.array([sd**2])))
            means.append(one.mean[0])
            squares.append(one.sd[0] ** 2 + one.mean[0] ** 2)
        mean = float(weights @ means)
        found[name] = (mean, float(np.sqrt(max(weights @ squares - mean**2, 0.0))))
    found["δ"] = (found["δ"][0] + float(np.median(models[0].values.y)), found["δ"][1])
    return found


def _same_at_all_scales(cross: Array, own: Array, _: Scale) -> tuple[Array, Array]:
    """Return the prior of numbers that are not of the chip's scales."""
    return cross, own


def _residuals(
    models: list[Hierarchy],
    entries: Entries,
    columns: Array,
    some: tuple[int, ...],
    offset: float,
    numbers: dict[str, tuple[float, float]],
) -> dict[str, float]:
    """Return ln(design's mean/film) of every design and mode."""
    values = models[0].values
    found = {}
    for k in values.groups:
        mean = float(np.mean(values.y[values.group == k]))
        taken = sum(columns[k, c] * numbers[CAUSES[c]][0] for c in some)
        found[" ".join(entries.groups[k])] = mean - offset - taken
    return found


def _measure_next(
    model: Model, chip: Hierarchy, some: tuple[int, ...], numbers: dict[str, tuple[float, float]]
) -> str:
    """Return which square beside the chip's devices would tell how far edges move.

    The strain that they release is ∝ 1/L, a common film is not; so the square furthest in 1/L.
    """
    film = model.film
    own = slackening(model)
    per_metre = -film.young / ((1 - film.poisson) * film.stress) / LADDER
    spread = chip.spread()[0]
    known = numbers[CAUSES[0]][1] if 0 in some else EDGE_SD
    best = int(np.argmax(np.abs(per_metre - own)))
    shift = abs(per_metre[best] - own) * known
    return (
        f"a square of {LADDER[best] * 1e6:.0f} µm on this chip: edges that move inwards by another "
        f"{known * 1e9:.2g} nm, which these data leave open, would shift it by "
        f"{100 * shift:.2g} % against the present devices, {shift / spread:.2g} times the spread "
        "from device to device"
    )
