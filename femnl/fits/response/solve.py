"""The search for the least misfit of a response.

Starts in turn, states and parameters in turn, and a way off the folds.
"""

import hashlib
import pickle
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache
from itertools import chain, islice

import numpy as np
from scipy.optimize import least_squares, leastsq

from femnl.core.choices import Use
from femnl.core.errors import ConvergenceError
from femnl.fits.response.implicit import refine
from femnl.fits.response.limits import Limits, Mask
from femnl.fits.response.misfit import Misfit
from femnl.fits.response.start import starts
from femnl.observe.response.sweeps import Array, Sweeps
from femnl.observe.response.theta import Layout

MAX_ROUNDS = 10
MAX_CALLS = 80
CLOSE = 1e-8
# A start has led to the answer when χ² exceeds what noise makes by less than this many of its
# standard deviations.
GOOD = 2.0
# A model that does not describe the data never reaches the noise; so many starts that agree to this
# factor tell that none does better.
SAME = 1.001
AGREED = 3
REMEMBERED = 4
"""Full searches whose answer is remembered."""
# Steps of α_y/α_c, in standard deviations, that take a fit off a fold where it got stuck.
RATIO = 2  # where α_y/α_c stands in θ
KICKS = (0.3, -0.3, 1.0, -1.0, 3.0, -3.0)


@dataclass
class _Search:
    """The best fit so far, and what each start reached."""

    misfit: Misfit
    low: Array
    high: Array
    free: Mask
    cost: float = np.inf
    theta: Array = field(default_factory=lambda: np.empty(0))
    reached: list[float] = field(default_factory=list)

    def descend(self, theta: Array, *, strict: bool) -> Misfit:
        """Minimise from θ and keep the result if it is better.

        `strict` admits only states that exist, and not their continuation past a fold.
        """
        tried = replace(self.misfit, strict=strict, last=None)
        found = settle(tried, np.clip(theta, self.low, self.high), self.low, self.high, self.free)
        cost = tried.cost(found)
        self.reached[-1] = min(self.reached[-1], cost)
        if cost < self.cost:
            self.cost = cost
            self.misfit = tried
            self.theta = found
        return tried

    def start(self, theta: Array) -> None:
        """Minimise from a new start.

        Where it meets a fold, states continued past the fold lead across, and then only those that
        exist decide.
        """
        self.reached.append(np.inf)
        if self.descend(theta, strict=True).folded:
            self.descend(theta, strict=False)
            self.descend(self.theta if self.theta.size else theta, strict=True)

    def found(self, noisy: float) -> bool:
        """Whether the best fit leaves only noise, or several starts agree that none does better."""
        agreed = np.count_nonzero(np.array(self.reached) < SAME * self.cost)
        return self.cost < noisy or bool(agreed >= AGREED)

    def leave_fold(self) -> None:
        """Move the fold over the points past it, where the best fit has such points."""
        if self.free[RATIO] and self.misfit.past_fold(self.theta):
            slopes = self.misfit.jacobian(self.theta)
            stuck = self.theta
            step = np.zeros(len(self.theta))
            variance = np.linalg.pinv(slopes.T @ slopes)[RATIO, RATIO]
            step[RATIO] = np.sqrt(max(variance, np.finfo(float).tiny))
            for kick in KICKS:
                self.descend(stuck + kick * step, strict=True)


def solve(
    sweeps: Sweeps,
    layout: Layout,
    use: Use,
    limits: Limits,
    first: Iterable[Array] = (),
    *,
    only_first: bool = False,
) -> tuple[Misfit, Array]:
    """Minimise the misfit from each start until one leaves only noise.

    The last few full searches are remembered, as one that finds no start that does is long, and the
    choice of a model asks for some of them again.

    Args: limits: of θ; first: starts tried before all others; only_first: whether there are no
        others.
    Return the best misfit, with its states, and θ.
    """
    problem = _Problem(sweeps, layout, use, limits, tuple(first), only_first)
    misfit, theta = problem.solution() if only_first else _remembered(problem)
    return replace(misfit), theta.copy()


@dataclass(frozen=True, eq=False)
class _Problem:
    """What `solve` is asked for; two are equal if all their numbers are."""

    sweeps: Sweeps
    layout: Layout
    use: Use
    limits: Limits
    first: tuple[Array, ...]
    only_first: bool

    @cached_property
    def _content(self) -> bytes:
        parts = [getattr(self, one.name) for one in fields(self)]
        return hashlib.sha256(pickle.dumps(parts)).digest()

    def __hash__(self) -> int:
        return hash(self._content)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Problem) and self._content == other._content

    def solution(self) -> tuple[Misfit, Array]:
        """Return the best misfit, with its states, and θ."""
        misfit = Misfit.of(self.sweeps, self.layout, self.use)
        search = _Search(misfit, self.limits.low, self.limits.high, self.limits.free)
        n_points = len(self.sweeps.frequency) * (2 if self.use == "complex" else 1)
        noisy = n_points + GOOD * np.sqrt(2 * n_points)
        for start in chain(self.first, self._others()):
            theta = self._bettered(start)
            if theta is None:
                continue
            search.start(theta)
            if not self.only_first and search.found(noisy):
                break
        if not search.theta.size:  # no start, or none with a finite misfit
            raise ConvergenceError(
                f"use = {self.use!r}: the points show no resonance to start from; choose another "
                "range or use='complex'"
            )
        search.leave_fold()
        return replace(search.misfit, last=None), search.theta

    def _others(self) -> Iterable[Array]:
        if self.only_first:
            return ()
        return _all_starts(self.sweeps, self.layout, self.use, self.limits)

    def _bettered(self, start: Array) -> Array | None:
        """Return a start, or what a linear estimate makes of it where that misfits less."""
        limits = self.limits
        candidates = [np.clip(start, limits.low, limits.high)]
        if self.use == "complex" and limits.free[2]:
            better = refine(self.sweeps, self.layout, candidates[0], limits.free)
            candidates.append(np.clip(better, limits.low, limits.high))
        # Of data far out of proportion a linear estimate may be no number
        finite = [theta for theta in candidates if np.isfinite(theta).all()]
        if not finite:
            return None
        return min(finite, key=Misfit.of(self.sweeps, self.layout, self.use).cost)


@lru_cache(maxsize=REMEMBERED)
def _remembered(problem: _Problem) -> tuple[Misfit, Array]:
    return problem.solution()


def _all_starts(sweeps: Sweeps, layout: Layout, use: Use, limits: Limits) -> Iterator[Array]:
    """Yield starts.

    A fit to a magnitude or to a phase alone starts first from a quick fit of both quadratures, and
    last from a full one. Where the readout is linear, that is the answer; where it is not, it does
    no harm.
    """
    if use == "complex" or not sweeps.phases:
        yield from starts(sweeps, use, layout)
        return
    full = replace(layout, gain=True, phase=True)

    def shared(theta: Array) -> Array:
        """Return the parameters of `layout` from those of a fit to both quadratures."""
        parts: list[Array | list[float]] = [
            theta[: full.gains.start],
            theta[full.gains] if layout.gain else [],
            theta[full.phases.start : full.backgrounds.start] if layout.phase else [],
            theta[full.backgrounds],
        ]
        return np.concatenate(parts)

    glance = Misfit.of(sweeps, full, "complex")
    no = Limits.none(full)
    for first in islice(starts(sweeps, "complex", full), 1):
        refined = refine(sweeps, full, first, no.free)
        yield shared(settle(glance, refined, no.low, no.high, no.free))
    yield from starts(sweeps, use, layout)
    yield shared(solve(sweeps, full, "complex", no)[1])


def settle(misfit: Misfit, theta: Array, low: Array, high: Array, free: Mask) -> Array:
    """Minimise and choose the states in turn, until the choice stands."""
    misfit.assign(theta)
    for _ in range(MAX_ROUNDS):
        theta = _descend(misfit, theta, low, high, free)
        if not misfit.assign(theta):
            break
    return theta


def _descend(misfit: Misfit, theta: Array, low: Array, high: Array, free: Mask) -> Array:
    """Minimise over the free parameters with the states fixed."""
    if not free.any():
        return theta

    def whole(part: Array) -> Array:
        full = theta.copy()
        full[free] = part
        return full

    def residual(part: Array) -> Array:
        return misfit.residual(whole(part))

    def slopes(part: Array) -> Array:
        return misfit.jacobian(whole(part))[:, free]

    low = low[free]
    high = high[free]
    if np.isinf(low).all() and np.isinf(high).all():
        found, *_ = leastsq(
            residual,
            theta[free],
            Dfun=slopes,
            full_output=True,
            ftol=CLOSE,
            xtol=CLOSE,
            gtol=CLOSE,
            maxfev=MAX_CALLS,
        )
        return whole(np.asarray(found))
    margin = 1e-9 * np.minimum(high - low, 1.0)
    result = least_squares(
        residual,
        np.clip(theta[free], low + margin, high - margin),
        slopes,
        (low, high),
        xtol=CLOSE,
        ftol=CLOSE,
        gtol=CLOSE,
        x_scale="jac",
        max_nfev=MAX_CALLS,
    )
    return whole(np.asarray(result.x))
