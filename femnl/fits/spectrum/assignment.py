"""Which simulated mode each measured line is.

The scale free, modes missing and lines spurious, with probabilities.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import betaln, gammaln, logsumexp

from femnl.core.errors import MeasurementError, ParameterError
from femnl.core.spectrum import Array, Assignment, Labelling

_MODEL_SD = np.geomspace(1e-5, 2e-2, 12)
"""Relative scatter of the simulation about the measured lines, marginalised with equal weights."""
MOST_LINES = 160
"""Lines that can be assigned: 160 take about a minute and a half, and the time grows as their cube.
"""
_KEPT = 60  # labellings whose neighbours are looked at in each round
_CHANGED = 2400
"""Of these labellings times lines, at most: neighbours grow with the lines, and their price too."""
_FEWEST_KEPT = 6
MOST_SCALES = 1200
"""Scales that are tried for each reach; of more, those at which most lines meet a mode."""
_REACHES = (3e-4, 3e-3, 2e-2)
"""How far the lines of a tight and of a loose simulation are from their modes, relative."""
_ROUNDS = 12
_ENOUGH = 1e-6  # probability below which a labelling is no start for others

Choice = tuple[int, ...]


class _Posterior:
    """Probability of labellings, scale and nuisances integrated out.

    ln f_i = ln c + ln g_j + noise of variance s² + (σ_i/f_i)² for a line i of mode j; ln c ~ N(0,
    scale_sd²) in closed form, s on a logarithmic grid; a mode inside the band is seen with a
    probability of flat prior, ∫p^D(1−p)^(M−D)dp = B(D+1, M−D+1); spurious lines are a Poisson
    process of exponential prior on their number, uniform in ln f: S!/2^(S+1)/R^S.
    """

    def __init__(
        self, frequency: Array, sd: Array, modes: Array, band: tuple[float, float], scale_sd: float
    ) -> None:
        order = np.argsort(frequency)
        self.order = order
        self.lines = np.log(frequency[order])
        self.spread = (sd / frequency)[order]
        self.modes = np.log(modes)
        self.low = np.log(band[0])
        self.high = np.log(band[1])
        self.scale_sd = scale_sd
        self.known: dict[Choice, float] = {}

    def scale(self, choice: Choice) -> tuple[Array, Array, Array]:
        """Return for each s the posterior mean and variance of ln c, and the log evidence."""
        taken = np.array([index for index, mode in enumerate(choice) if mode >= 0], dtype=int)
        shift = self.lines[taken] - self.modes[[choice[index] for index in taken]]
        variance = _MODEL_SD[:, None] ** 2 + self.spread[taken] ** 2
        precision = 1 / self.scale_sd**2 + np.sum(1 / variance, axis=1)
        mean = np.sum(shift / variance, axis=1) / precision
        chi2 = np.sum(shift**2 / variance, axis=1) - mean**2 * precision
        evidence = -0.5 * (
            chi2
            + np.sum(np.log(2 * np.pi * variance), axis=1)
            + np.log(precision * self.scale_sd**2)
        )
        return mean, 1 / precision, evidence

    def log(self, choice: Choice) -> float:
        """Return the logarithm of the unnormalised posterior of a labelling.

        −1 in `choice` is a spurious line.
        """
        if choice not in self.known:
            seen = sum(mode >= 0 for mode in choice)
            mean, _, evidence = self.scale(choice)
            centre = mean[int(np.argmax(evidence))]
            inside = (self.modes + centre > self.low) & (self.modes + centre < self.high)
            inside[[mode for mode in choice if mode >= 0]] = True
            count = int(np.count_nonzero(inside))
            spurious = len(choice) - seen
            prior = betaln(seen + 1, count - seen + 1)
            stray = (
                gammaln(spurious + 1)
                - (spurious + 1) * np.log(2)
                - spurious * np.log(self.high - self.low)
            )
            self.known[choice] = float(logsumexp(evidence) - np.log(_MODEL_SD.size) + prior + stray)
        return self.known[choice]


def assign(
    frequency: ArrayLike,
    frequency_sd: ArrayLike,
    labels: Sequence[str],
    simulated: ArrayLike,
    band: tuple[float, float],
    scale_sd: float = 0.3,
) -> Assignment:
    """Give measured lines to simulated modes.

    Every labelling has a posterior probability (see `_Posterior`); the likely ones are found by
    aligning the two lists at every ratio of a line to a mode, and by exchanging, dropping and
    adding single modes until nothing likelier turns up. Probabilities are normalised over all that
    were met.
    Args: frequency, frequency_sd [Hz] of the lines (n,); labels and simulated [Hz] of the modes
    (m,); band [Hz]: the swept range, in which a mode without a line counts as missing; scale_sd:
    prior standard deviation of the logarithm of measured over simulated frequency (0.3: the stress
    known to a factor of two).
    Returns: Assignment. Raises: ParameterError for empty or unequal lists, or lines outside the
    band; MeasurementError for more than MOST_LINES.
    Valid: one common scale; modes closer to each other than the simulation is right are reported as
    ambiguous.
    """
    lines, sd, modes = (
        np.atleast_1d(np.asarray(values, dtype=float))
        for values in (frequency, frequency_sd, simulated)
    )
    if lines.size == 0 or modes.size == 0 or lines.size != sd.size or modes.size != len(labels):
        sizes = (
            f"{lines.size} lines, {sd.size} of their sd, {modes.size} modes and "
            f"{len(labels)} labels"
        )
        raise ParameterError(
            f"assign: {sizes}; give as many sd as lines and as many labels as modes, at least one"
        )
    need_few_lines(lines.size)
    if not (0 < band[0] <= lines.min() and lines.max() <= band[1]):
        raise ParameterError(
            f"assign: lines from {lines.min():g} to {lines.max():g} Hz leave the band {band[0]:g} "
            f"to {band[1]:g} Hz; widen it"
        )
    posterior = _Posterior(lines, sd, modes, band, scale_sd)
    found = _enumerate(posterior)
    weights = np.array(list(found.values()))
    probability = dict(zip(found, np.exp(weights - logsumexp(weights)), strict=True))
    ranked = sorted(probability, key=lambda choice: -probability[choice])
    best = ranked[0]
    mean, variance, evidence = posterior.scale(best)
    weight = np.exp(evidence - logsumexp(evidence))
    centre = float(weight @ mean)
    spread = float(np.sqrt(weight @ (variance + (mean - centre) ** 2)))
    inside = (posterior.modes + centre > posterior.low) & (
        posterior.modes + centre < posterior.high
    )
    groups = _ambiguous(best, probability)
    labelling = _labelling(posterior, best, labels, probability[best])
    away = [
        np.nan if mode is None else line / (np.exp(centre) * modes[mode]) - 1
        for line, mode in zip(lines, labelling.mode, strict=True)
    ]
    return Assignment(
        best=labelling,
        runner_up=_labelling(posterior, ranked[1], labels, probability[ranked[1]])
        if len(ranked) > 1
        else None,
        scale=float(np.exp(centre)),
        scale_sd=float(np.exp(centre) * spread),
        model_sd=float(np.exp(weight @ np.log(_MODEL_SD))),
        missing=tuple(labels[mode] for mode in np.flatnonzero(inside).tolist() if mode not in best),
        ambiguous=tuple(tuple(labels[mode] for mode in sorted(group)) for group in groups),
        up_to_ambiguous=float(
            sum(
                share
                for choice, share in probability.items()
                if _merged(choice, groups) == _merged(best, groups)
            )
        ),
        deviation=np.array(away),
    )


def need_few_lines(count: int) -> None:
    """Refuse more lines than can be assigned to modes. Raises: MeasurementError."""
    if count > MOST_LINES:
        raise MeasurementError(
            f"spectrum: {count:,} lines without labels, and at most {MOST_LINES} can be assigned "
            "to modes in minutes; leave out the highest, or label them by their modes"
        )


def _enumerate(posterior: _Posterior) -> dict[Choice, float]:
    """Return likely labellings with their log posterior.

    The search begins at seeds from all ratios, and goes on to neighbours of the best until nothing
    new is likely.
    """
    found = {choice: posterior.log(choice) for choice in _seeds(posterior)}
    looked: set[Choice] = set()
    kept = max(min(_KEPT, _CHANGED // posterior.lines.size), _FEWEST_KEPT)
    for _ in range(_ROUNDS):
        top = max(found.values())
        starts = [
            choice
            for choice in sorted(found, key=lambda one: -found[one])[:kept]
            if found[choice] > top + np.log(_ENOUGH)
        ]
        fresh = {
            other
            for choice in starts
            if choice not in looked
            for other in _neighbours(posterior, choice)
        } - found.keys()
        looked.update(starts)
        if not fresh:
            break
        found |= {choice: posterior.log(choice) for choice in fresh}
    return found


def _seeds(posterior: _Posterior) -> set[Choice]:
    """Return the nearest modes at the scale of every pair of line and mode, each assignment once.

    Modes are sought for a tight and for a loose simulation. In long lists only the scales at which
    most lines meet a mode are tried.
    """
    seeds = {(-1,) * posterior.lines.size}
    all_scales = (posterior.lines[:, None] - posterior.modes).ravel()
    for reach in _REACHES:
        for scale in likely_scales(np.sort(all_scales), reach):
            away = np.abs(posterior.lines[:, None] - posterior.modes[None] - scale)
            seeds.add(_greedy(np.where(away < reach, away, np.inf)))
    return seeds


def likely_scales(scales: Array, reach: float) -> Array:
    """Return the scales that most others are within reach of, all where they are few.

    Args: scales: of all pairs of line and mode, sorted (n,). Of those that lie within half of the
    reach of each other one stands for all.
    """
    if scales.size <= MOST_SCALES:
        return scales
    meet = np.searchsorted(scales, scales + reach) - np.searchsorted(scales, scales - reach)
    order = np.argsort(-meet, kind="stable")
    _, first = np.unique(np.floor(2 * scales[order] / reach), return_index=True)
    return np.asarray(scales[order[np.sort(first)[:MOST_SCALES]]])


def _greedy(away: Array) -> Choice:
    """Return the pairs from the closest on, every line and mode once."""
    choice = [-1] * away.shape[0]
    taken: set[int] = set()
    rows, columns = np.nonzero(np.isfinite(away))
    for place in np.argsort(away[rows, columns], kind="stable"):
        line = int(rows[place])
        mode = int(columns[place])
        if choice[line] < 0 and mode not in taken:
            choice[line] = mode
            taken.add(mode)
    return tuple(choice)


def _neighbours(posterior: _Posterior, choice: Choice) -> Iterable[Choice]:
    """Labellings that differ in one line, or in two that exchange their modes."""
    mean, _, evidence = posterior.scale(choice)
    expected = posterior.modes + mean[int(np.argmax(evidence))]
    for line, mode in enumerate(choice):
        near = np.flatnonzero(np.abs(expected - posterior.lines[line]) < 0.06)
        for other in [-1, *near.tolist()]:
            if other == mode:
                continue
            changed = list(choice)
            if other >= 0 and other in choice:
                changed[choice.index(other)] = mode
                yield (*changed[:line], other, *changed[line + 1 :])
                changed[choice.index(other)] = -1
            changed[line] = other
            yield tuple(changed)


def _labelling(
    posterior: _Posterior, choice: Choice, labels: Sequence[str], probability: float
) -> Labelling:
    """Return the labelling in the order in which the lines were given."""
    modes: list[int | None] = [None] * len(choice)
    for place, mode in zip(posterior.order, choice, strict=True):
        modes[int(place)] = mode if mode >= 0 else None
    return Labelling(
        tuple(modes),
        tuple(None if mode is None else labels[mode] for mode in modes),
        float(probability),
    )


def _ambiguous(best: Choice, probability: dict[Choice, float]) -> list[set[int]]:
    """Return groups of modes that trade places between likely labellings.

    A mode belongs to a group where it has a chance of more than one in twenty at a line.
    """
    groups: list[set[int]] = []
    for line, mode in enumerate(best):
        chances: dict[int, float] = {}
        for choice, share in probability.items():
            chances[choice[line]] = chances.get(choice[line], 0.0) + share
        rivals = {other for other, share in chances.items() if share > 0.05 and other >= 0} | (
            {mode} if mode >= 0 else set()
        )
        if len(rivals) > 1:
            joined = [group for group in groups if group & rivals]
            groups = [group for group in groups if not group & rivals] + [rivals.union(*joined)]
    return groups


def _merged(choice: Choice, groups: list[set[int]]) -> Choice:
    """Return the labelling with every ambiguous mode replaced by the first of its group."""
    first = {mode: min(group) for group in groups for mode in group}
    return tuple(first.get(mode, mode) for mode in choice)
