"""One quantity of all devices of a chip as a Gaussian hierarchy, marginalised over its scales.

    y_i = μ_g(i) + φ(x_i)·β + u_d(i) + v_i + e_i

y: logarithm of frequency or quality factor. μ: one mean for each group, that is each mode of each
design, with a flat prior unless `between` says how the means hang together. β ~ N(0, a²): the
smooth variation over the chip, none, a plane or a bowl, common to all groups. u ~ N(0, τ²): spread
from device to device. v ~ N(0, κ²): what modes of one device differ by. e: measurement, of known
standard deviation.

Given the scales a, τ and κ, everything is Gaussian and exact. The scales are summed over on a grid,
uniform in their logarithms, as are the three forms of the variation, each with a third of the prior
probability (Rasmussen & Williams, Gaussian Processes for Machine Learning, MIT Press 2006,
chapters 2.7 and 5.4).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp

Array = npt.NDArray[np.float64]
Places = npt.NDArray[np.int64]
Scale = tuple[str, float, float, float]
"""Form of the variation, and a, τ, κ."""
FIELDS = ("none", "plane", "bowl")
"""Forms of the variation over the chip: the last has all terms of second order as well."""
SPREADS = np.geomspace(0.02, 3.0, 16)
"""Spread from device to device, in parts of what the devices show without any field."""
RELIEFS = np.geomspace(0.1, 10.0, 7)
"""Variation over the chip, in the same unit, for one standard deviation of the places."""
SPLITS = (0.0, 0.3, 1.0)
"""Spread between modes of one device, in parts of that from device to device."""
FLAT = 20.0
"""Standard deviation of the prior of a group's mean about its median, in the same unit."""


@dataclass(frozen=True)
class Values:
    """A quantity of a chip, one entry for each mode of each device.

    y: its logarithm. sd: standard deviation of y by measurement. device: number of the device.
    group: number of the group that shares a mean. place: coordinates on the chip, (n, 2), in any
    unit.
    """

    y: Array
    sd: Array
    device: Places
    group: Places
    place: Array

    def without(self, devices: frozenset[int]) -> "Values":
        """Return the entries of all other devices."""
        kept = ~np.isin(self.device, [*devices])
        return self.only(kept)

    def only(self, kept: npt.NDArray[Any]) -> "Values":
        """Return some entries."""
        return Values(
            self.y[kept], self.sd[kept], self.device[kept], self.group[kept], self.place[kept]
        )

    @cached_property
    def unit(self) -> float:
        """Robust standard deviation of y within its groups: 1.4826 of the median deviation."""
        off = np.concatenate(
            [self.y[self.group == g] - np.median(self.y[self.group == g]) for g in self.groups]
        )
        large = off[np.abs(off) > 0]
        return 1.4826 * float(np.median(np.abs(large))) if large.size else 1e-12

    @property
    def groups(self) -> Places:
        """Numbers of the groups that have entries."""
        return np.unique(self.group)


@dataclass(frozen=True)
class Hierarchy:
    """The model of one quantity.

    centre, scale: of the places, in their unit. unit: what scales are counted in, in units of y.
    between: covariance of the means of all groups, (groups, groups); None for means of their own.
    """

    values: Values
    centre: Array
    scale: float
    unit: float
    between: Array | None = None

    def terms(self, place: Array, field: str) -> Array:
        """Return the terms φ of a variation over the chip at places, (n, k)."""
        if field == "none":
            return np.zeros((len(place), 0))
        x, y = ((place - self.centre) / self.scale).T
        plane = [x, y]
        # Half as large a prior: a bowl of one radius is as high as a plane over one
        bowl = [(x**2 + y**2 - 2) / 2, (x**2 - y**2) / 2, x * y / 2]
        return np.array(plane if field == "plane" else plane + bowl).T

    @property
    def fields(self) -> tuple[str, ...]:
        """Forms of the variation that the places allow: without places, none."""
        return FIELDS if np.isfinite(self.values.place).all() else FIELDS[:1]

    @cached_property
    def scales(self) -> list[Scale]:
        """Every form and scale that is summed over: field, a, τ, κ, in units of y."""
        several = len(np.unique(self.values.device)) < len(self.values.y)
        splits = SPLITS if several else (0.0,)
        found = []
        for field in self.fields:
            for relief in RELIEFS if field != "none" else (0.0,):
                for spread in SPREADS:
                    found += [(field, relief, spread, split) for split in splits]
        return [(f, a * self.unit, t * self.unit, t * s * self.unit) for f, a, t, s in found]

    @cached_property
    def log_prior(self) -> Array:
        """Prior of each entry of `scales`: every form the same, and every scale within it."""
        forms = [field for field, *_ in self.scales]
        return np.array([-np.log(forms.count(f) * len(self.fields)) for f in forms])

    def covariance(self, scale: Scale, v: Values, w: Values) -> Array:
        """Return the covariance of the entries v with w, without what measurement adds."""
        field, a, spread, split = scale
        alike = v.group[:, None] == w.group[None, :]
        same = v.device[:, None] == w.device[None, :]
        smooth = a**2 * self.terms(v.place, field) @ self.terms(w.place, field).T
        mode = split**2 * (same & alike)
        means = (FLAT * self.unit) ** 2 * alike
        if self.between is not None:
            means = self.between[np.ix_(v.group, w.group)]
        return np.asarray(means + smooth + spread**2 * same + mode)

    @cached_property
    def solved(self) -> list[tuple[Array, Array]]:
        """K⁻¹ and K⁻¹(y − ȳ) for every scale."""
        v = self.values
        found = []
        for scale in self.scales:
            total = self.covariance(scale, v, v) + np.diag(v.sd**2)
            inverse = np.asarray(np.linalg.inv(total), dtype=np.float64)
            solved: Array = inverse @ (v.y - self.middle(v))
            found.append((inverse, solved))
        return found

    def middle(self, of: Values) -> Array:
        """Return what y of entries is counted from.

        The median of their group, or of all data where groups have no entry or hang together.
        """
        v = self.values
        found = np.full(len(of.y), np.median(v.y))
        if self.between is None:
            for g in v.groups:
                found[of.group == g] = np.median(v.y[v.group == g])
        return found

    @cached_property
    def log_likelihoods(self) -> Array:
        """Log p(y) for every scale."""
        y = self.values.y - self.middle(self.values)
        return np.array(
            [
                -0.5 * y @ solved + 0.5 * np.linalg.slogdet(inverse)[1] - 0.5 * len(y) * LOG2PI
                for inverse, solved in self.solved
            ]
        )

    @cached_property
    def log_evidence(self) -> float:
        """Log p(y), all scales and forms summed over."""
        return float(logsumexp(self.log_likelihoods + self.log_prior))

    @cached_property
    def weights(self) -> Array:
        """Posterior probability of every scale."""
        return np.exp(self.log_likelihoods + self.log_prior - self.log_evidence)

    def probability(self, field: str) -> float:
        """Posterior probability of a form of the variation."""
        return float(
            sum(w for w, s in zip(self.weights, self.scales, strict=True) if s[0] == field)
        )

    def expected(self, priors: Callable[[Scale], tuple[Array, Array]]) -> "Mixture":
        """Return what Gaussian numbers of the model are, given the data.

        priors: for a scale, the numbers' covariance with the data, (k, n), and their own prior
        variances, (k,).
        """
        means, variances = [], []
        for scale, (inverse, solved) in zip(self.scales, self.solved, strict=True):
            cross, own = priors(scale)
            means.append(cross @ solved)
            variances.append(own - np.einsum("ij,jk,ik->i", cross, inverse, cross))
        return Mixture(self.weights[:, None], np.array(means), np.array(variances))

    def over_chip(self, place: Array) -> "Mixture":
        """Return the smooth variation at places, against its mean over the devices."""
        devices = [
            np.flatnonzero(self.values.device == d)[0] for d in np.unique(self.values.device)
        ]

        def prior(scale: Scale) -> tuple[Array, Array]:
            field, a, _, _ = scale
            known = self.terms(self.values.place, field)
            new = self.terms(place, field) - known[devices].mean(axis=0)
            return a**2 * new @ known.T, a**2 * (new**2).sum(axis=1)

        return self.expected(prior)

    def spread(self) -> tuple[float, float]:
        """Return the spread from device to device, and its standard deviation."""
        each = np.array([np.hypot(t, k) for _, _, t, k in self.scales])
        mean = float(self.weights @ each)
        return mean, float(np.sqrt(max(self.weights @ each**2 - mean**2, 0.0)))

    def predict(self, new: Values) -> "Mixture":
        """Return what y is to be at new entries, with their own measurement errors.

        New entries are of devices that are not in the data, each with its own deviation.
        """
        means, variances = [], []
        for scale, (inverse, solved) in zip(self.scales, self.solved, strict=True):
            cross = self.covariance(scale, new, self.values)
            own = np.diag(self.covariance(scale, new, new)) + new.sd**2
            means.append(self.middle(new) + cross @ solved)
            variances.append(own - np.einsum("ij,jk,ik->i", cross, inverse, cross))
        return Mixture(self.weights[:, None], np.array(means), np.array(variances))

    def left_out(self) -> "Mixture":
        """Return what y of each device is to be by all others.

        By the inverse: y − (K⁻¹)_dd⁻¹ (K⁻¹y)_d, with the weights that the others give the scales.
        """
        v = self.values
        count = len(self.scales)
        weights = np.empty((count, len(v.y)))
        means = np.empty_like(weights)
        variances = np.empty_like(weights)
        for d in np.unique(v.device):
            own = np.flatnonzero(v.device == d)
            log_own = np.empty(count)
            for k, (inverse, solved) in enumerate(self.solved):
                block = np.linalg.inv(inverse[np.ix_(own, own)])
                off = block @ solved[own]
                means[k, own] = v.y[own] - off
                variances[k, own] = np.diag(block)
                log_own[k] = (
                    -0.5 * off @ solved[own]
                    - 0.5 * np.linalg.slogdet(block)[1]
                    - 0.5 * len(own) * LOG2PI
                )
            without = self.log_likelihoods + self.log_prior - log_own
            weights[:, own] = np.exp(without - logsumexp(without))[:, None]
        return Mixture(weights, means, variances)


LOG2PI = float(np.log(2 * np.pi))


@dataclass(frozen=True)
class Mixture:
    """Normal distributions with weights, (scales, n) each, for n numbers."""

    weights: Array
    means: Array
    variances: Array

    @cached_property
    def mean(self) -> Array:
        """Mean of each number."""
        return np.asarray((self.weights * self.means).sum(axis=0))

    @cached_property
    def sd(self) -> Array:
        """Standard deviation of each number."""
        second = (self.weights * (self.variances + self.means**2)).sum(axis=0)
        return np.asarray(np.sqrt(np.maximum(second - self.mean**2, 0.0)))

    def log_density(self, y: Array, wider: float = 0.0) -> Array:
        """Log density at y; each normal wider by a standard deviation."""
        variance = self.variances + wider**2
        log_each = -0.5 * ((y - self.means) ** 2 / variance + np.log(variance) + LOG2PI)
        # A scale that is out of the question has the weight 0
        log_weights = np.log(np.maximum(self.weights, np.finfo(float).tiny))
        return np.asarray(logsumexp(log_weights + log_each, axis=0))


def hierarchy(values: Values, unit: float | None = None, between: Array | None = None) -> Hierarchy:
    """Return the model of some entries; unit: what scales are counted in, by default their own."""
    first = [np.flatnonzero(values.device == d)[0] for d in np.unique(values.device)]
    places = values.place[first]
    centre = places.mean(axis=0)
    scale = float(np.sqrt(((places - centre) ** 2).sum(axis=1).mean() / 2)) or 1.0
    return Hierarchy(values, centre, scale, unit or values.unit, between)
