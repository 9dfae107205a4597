"""The search for lines in a wide sweep: the strongest first, then all that touch together."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from femnl.core.errors import ConvergenceError
from femnl.fits.spectrum.alone import NARROWEST, is_met
from femnl.fits.spectrum.lines import REACH, Array, Cluster, Complex, fit_cluster, polynomials
from femnl.fits.spectrum.scan import scan

_PASSES = 20
_SMOOTH = 8  # degree of the background over the whole sweep
_ROBUST = 12
_SHARES = (0.5, 0.2, 0.08)  # of the widest line of a badly fitted group, tried as the widest one
_ROUNDS = 2  # of fitting each group with the others taken off, in every pass
_APART = 8.0  # linewidths that lines found in the same pass must lie apart
_TOUCH = 3.0  # linewidths within which lines are fitted together
_BACKGROUND = 0.95  # of the widest linewidth: such a line is a bend of the background
_MOST = 20_000_000  # work of one search: twice that of sweeps of many lines
_RAYLEIGH = 1.1774  # median of |noise| over its standard deviation in each quadrature
_COARSER = 4.0  # times the noise, at least, of the search that follows one without end


@dataclass
class Work:
    """How much has been fitted, in points times unknowns."""

    done: int = 0


@dataclass(frozen=True)
class Task:
    """What lines are sought by.

    noise [V] per quadrature; limit: fall of χ² that a line must buy; widest: linewidth [Hz] of a
    line that is not background; work: what the search has taken so far.
    """

    noise: float
    limit: float
    widest: float
    work: Work


@dataclass
class _TooMuchError(Exception):
    """The search goes on beyond what it may take; with the residual it had come to [V]."""

    residual: float


def bounded_search(f: Array, volts: Complex, task: Task) -> tuple[list[Cluster], tuple[str, ...]]:
    """Search for lines with bounded work.

    Where no sum of lines describes the sweep, every deviation would become a line of its own,
    without end. There what the lines leave counts as noise.
    """
    told: tuple[str, ...] = ()
    for _ in range(_PASSES):
        try:
            return _search(f, volts, task), told
        except _TooMuchError as stopped:
            noise = max(_COARSER * task.noise, stopped.residual)
            task = Task(noise, task.limit, task.widest, Work())
            told = (f"no sum of lines describes the sweep; they are those above {noise:.3g} V",)
    raise ConvergenceError("response: the search for lines does not end; sweep a part of it")


def _search(f: Array, volts: Complex, task: Task) -> list[Cluster]:
    """Return all lines of the sweep; the background is taken anew from what the lines leave."""
    clusters: list[Cluster] = []
    for _ in range(_PASSES):
        flat = volts - smooth_background(f, volts - sum_of_lines(f, clusters))
        found = _relax(f, flat, clusters, np.empty((0, 2)), task)
        found = _greedy(f, flat, _drop_weak(f, flat, found, task), task)
        found = _rebuild(f, flat, found, task)
        if _settled(clusters, found):
            return found
        clusters = found
    return clusters


def _settled(before: list[Cluster], after: list[Cluster]) -> bool:
    """Whether the lines are the same to a tenth of their standard deviation."""
    old, new = (
        np.concatenate([np.empty(0), *(cluster.frequency for cluster in clusters)])
        for clusters in (before, after)
    )
    sd = np.concatenate([np.empty(0), *(cluster.frequency_sd for cluster in after)])
    order = np.argsort(new)
    return old.size == new.size and bool(
        np.all(np.abs(np.sort(old) - new[order]) <= 0.1 * sd[order])
    )


def _greedy(f: Array, flat: Complex, clusters: list[Cluster], task: Task) -> list[Cluster]:
    """Add the strongest lines of the residual, fit, drop what does not pay, and repeat."""
    for _ in range(_PASSES):
        left = flat - sum_of_lines(f, clusters)
        if task.work.done > _MOST:
            raise _TooMuchError(float(np.median(np.abs(left))) / _RAYLEIGH)
        fresh = _fresh_lines(*scan(f, left, task.noise, task.widest), task.limit)
        if not len(fresh):
            return clusters
        found = _drop_weak(f, flat, _relax(f, flat, clusters, fresh, task), task)
        if _table(found).shape[0] <= _table(clusters).shape[0]:
            return clusters
        clusters = found
    return clusters


def _rebuild(f: Array, flat: Complex, clusters: list[Cluster], task: Task) -> list[Cluster]:
    """Search groups that are fitted badly once more from nothing, with narrower lines first.

    A wide line may have swallowed others.
    """
    kept = list(clusters)
    for cluster in clusters:
        if is_met(cluster, task.limit):
            continue
        place = kept.index(cluster)
        left = flat - sum_of_lines(f, kept[:place] + kept[place + 1 :])
        inside = (f >= cluster.window[0]) & (f <= cluster.window[1])
        tried = [cluster]
        for share in _SHARES:
            narrower = replace(task, widest=share * float(cluster.linewidth.max()))
            narrow = _greedy(f[inside], left[inside], [], narrower)
            if narrow:
                tried.append(_fit(f, left, _table(narrow), cluster.window, task))
        kept[place] = min(tried, key=lambda other: other.chi2 + task.limit * other.frequency.size)
    return (
        _drop_weak(f, flat, kept, task)
        if any(one is not other for one, other in zip(kept, clusters, strict=True))
        else clusters
    )


def smooth_background(f: Array, volts: Complex) -> Complex:
    """Return a smooth complex curve through what is left.

    Weights 1/(1 + (r/s)²) keep lines from pulling it (s: median residual).
    """
    basis = np.polynomial.legendre.legvander(2 * (f - f[0]) / (f[-1] - f[0]) - 1, _SMOOTH).astype(
        complex
    )
    curve: Complex = np.full(f.shape, np.median(volts.real) + 1j * np.median(volts.imag))
    for _ in range(_ROBUST):
        away = np.abs(volts - curve)
        root = 1 / np.hypot(1.0, away / max(float(np.median(away)), 1e-300))
        curve = np.asarray(
            basis @ np.linalg.lstsq(basis * root[:, None], volts * root, rcond=None)[0]
        )
    return curve


def sum_of_lines(f: Array, clusters: Iterable[Cluster]) -> Complex:
    """Return all lines of the clusters at f, in V."""
    total: Complex = np.zeros(f.shape, dtype=complex)
    for cluster in clusters:
        total = total + cluster.lines(f)
    return total


def _fresh_lines(score: Array, centre: Array, width: Array, limit: float) -> Array:
    """Return strongest filters, each alone within its reach, as frequency and linewidth (n, 2)."""
    taken: list[tuple[float, float]] = []
    for index in np.argsort(score)[::-1]:
        if score[index] < limit or (taken and score[index] < 1e-2 * score.max()):
            break
        if all(
            abs(centre[index] - other) > _APART * max(width[index], breadth)
            for other, breadth in taken
        ):
            taken.append((float(centre[index]), float(width[index])))
    return np.array(taken).reshape(-1, 2)


def _table(clusters: list[Cluster]) -> Array:
    rows = [np.column_stack([cluster.frequency, cluster.linewidth]) for cluster in clusters]
    return np.vstack(rows) if rows else np.empty((0, 2))


def _groups(table: Array) -> list[Array]:
    """Return lines that touch each other, directly or through others."""
    order = np.argsort(table[:, 0] - _TOUCH * table[:, 1])
    groups: list[list[int]] = []
    edge = -np.inf
    for index in order:
        frequency, width = table[index]
        if frequency - _TOUCH * width < edge:
            groups[-1].append(int(index))
        else:
            groups.append([int(index)])
        edge = max(edge, frequency + _TOUCH * width)
    return [table[group] for group in groups]


def _relax(
    f: Array,
    volts: Complex,
    clusters: list[Cluster],
    fresh: Array,
    task: Task,
) -> list[Cluster]:
    """Fit every group of lines with all others taken off, until their tails have settled."""
    new = {tuple(row) for row in fresh}
    for _ in range(_ROUNDS):
        for group in _groups(np.vstack([_table(clusters), np.array(sorted(new)).reshape(-1, 2)])):
            others = [
                cluster for cluster in clusters if not np.isin(cluster.frequency, group[:, 0]).any()
            ]
            left = volts - sum_of_lines(f, others)
            tried = [_fit(f, left, start, _window(f, group), task) for start in _starts(group, new)]
            clusters = [
                *others,
                min(tried, key=lambda cluster: cluster.chi2 + task.limit * cluster.frequency.size),
            ]
            new -= {tuple(row) for row in group}
    return clusters


def _starts(group: Array, fresh: set[tuple[float, ...]]) -> list[Array]:
    """Return starting points: the lines as found, and others with one of them split.

    An old line is split in two where a new line lies on it.
    """
    starts = [group]
    new = [row for row in group if tuple(row) in fresh]
    for row in new:
        old = [
            other
            for other in group
            if tuple(other) not in fresh and abs(other[0] - row[0]) < 2 * max(other[1], row[1])
        ]
        if old:
            near = min(old, key=lambda other: abs(other[0] - row[0]))
            rest = [
                other for other in group if other is not row and not np.array_equal(other, near)
            ]
            width = near[1]
            for gap, share in ((0.3, 0.7), (0.7, 0.9)):
                starts.append(
                    np.array(
                        [
                            *rest,
                            [near[0] - gap * width, share * width],
                            [near[0] + gap * width, share * width],
                        ]
                    )
                )
    return starts


def _window(f: Array, table: Array) -> tuple[float, float]:
    """Return part of the sweep that lines reach, with as many points as the fit has unknowns."""
    spacing = float(np.median(np.diff(f)))
    reach = np.maximum(REACH * table[:, 1], 8 * spacing)
    low = float(np.min(table[:, 0] - reach))
    high = float(np.max(table[:, 0] + reach))
    inside = (f >= low) & (f <= high)
    while np.count_nonzero(inside) < min(6 + 4 * table.shape[0], f.size):
        low = low - 4 * spacing
        high = high + 4 * spacing
        inside = (f >= low) & (f <= high)
    return float(f[inside][0]), float(f[inside][-1])


def _fit(
    f: Array, volts: Complex, start: Array, window: tuple[float, float], task: Task
) -> Cluster:
    inside = (f >= window[0]) & (f <= window[1])
    narrowest = NARROWEST * float(np.median(np.diff(f[inside])))
    task.work.done += int(np.count_nonzero(inside)) * (4 * start.shape[0] + 6) ** 2
    widths = (narrowest, max(task.widest, 2 * narrowest))
    return fit_cluster(f[inside], volts[inside], task.noise, start, window, widths)


def _significance(cluster: Cluster) -> Array:
    """Fall of χ² that each line buys, from its height over its standard deviation (Wald)."""
    return np.asarray((np.abs(cluster.amplitude) / np.maximum(cluster.amplitude_sd, 1e-300)) ** 2)


def _gain(f: Array, volts: Complex, cluster: Cluster, index: int, task: Task) -> float:
    """Fall of χ² by line `index` of a cluster, other clusters taken off.

    Its window is fitted without it.
    """
    rest = np.delete(np.column_stack([cluster.frequency, cluster.linewidth]), index, axis=0)
    if rest.shape[0]:
        return _fit(f, volts, rest, cluster.window, task).chi2 - cluster.chi2
    inside = (f >= cluster.window[0]) & (f <= cluster.window[1])
    basis = polynomials(f[inside], cluster.window).astype(complex)
    residual = volts[inside] - basis @ np.linalg.lstsq(basis, volts[inside], rcond=None)[0]
    return float(np.sum(np.abs(residual) ** 2) / task.noise**2) - cluster.chi2


def _drop_weak(f: Array, volts: Complex, clusters: list[Cluster], task: Task) -> list[Cluster]:
    """Take out one by one the lines and bends of the background that do not pay."""
    kept = list(clusters)
    for cluster in clusters:
        place = kept.index(cluster)
        left = volts - sum_of_lines(f, kept[:place] + kept[place + 1 :])
        while cluster.frequency.size:
            worth = _significance(cluster)
            # A line narrower than the spacing has no certain height, and yet its fall of χ² is
            # certain.
            for index in np.flatnonzero(worth < task.limit):
                worth[index] = _gain(f, left, cluster, int(index), task)
            worth[cluster.linewidth > _BACKGROUND * task.widest] = 0.0
            weakest = int(np.argmin(worth))
            if worth[weakest] >= task.limit:
                break
            rest = np.delete(
                np.column_stack([cluster.frequency, cluster.linewidth]), weakest, axis=0
            )
            if not rest.shape[0]:
                kept.pop(place)
                break
            kept[place] = cluster = _fit(f, left, rest, _window(f, rest), task)
    return kept
