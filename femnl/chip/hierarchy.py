"""One quantity of all devices of a chip as a Gaussian hierarchy, marginalised over its scales.

    y_i = μ_g(i) + φ(x_i)·β + u_d(i) + v_i + e_i

y: logarithm of frequency or quality factor. μ: one mean for each group, that is each mode of each
design, each with a wide prior of its own unless `factors` relate them. β ~ N(0, a²): the
smooth variation over the chip, none, a plane or a bowl, common to all groups. u ~ N(0, τ²): spread
from device to device. v ~ N(0, κ²): what modes of one device differ by. e: measurement, of known
standard deviation.

Given the scales a, τ and κ, everything is Gaussian and exact. The scales are summed over on a grid,
uniform in their logarithms, as are the three forms of the variation, each with a third of the prior
probability (Rasmussen & Williams, Gaussian Processes for Machine Learning, MIT Press 2006,
chapters 2.7 and 5.4).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from femnl.chip.mixture import LOG2PI, TINY, Mixture
from femnl.chip.scales import FIELDS, PLANE, TERMS, Scales, grid
from femnl.chip.sums import Sums, sums_of
from femnl.chip.values import LEAST_SHARE, Array, Integers, Values
from femnl.core.robust import MAD, least_absolute

MEAN_SD = 20.0
"""Standard deviation of the prior of a group's mean about its median, in the same unit."""
ENOUGH = 12
"""Devices from which on what a bowl leaves is no chance: twice its terms and its mean."""


@dataclass(frozen=True)
class Hierarchy:
    """The model of one quantity, solved in the space of its features.

    y = U·(d w) + noise with w ~ N(0, 1): means of groups and terms of the variation are features,
    of which d are the prior standard deviations. The noise is that of each device for itself, so
    sums over devices are all that is needed, and to leave one out is to subtract it.

    centre, scale: of the places, in their unit. unit: what scales are counted in, in units of y.
    factors: F of the means of groups μ = F w, (groups, k); None for means of their own.
    """

    values: Values
    centre: Array
    scale: float
    unit: float
    factors: Array | None = None

    def terms(self, place: Array, field: str = "bowl") -> Array:
        """Return the terms φ of a variation over the chip at places, (n, 5), 0 where not in it."""
        found = np.zeros((len(place), TERMS))
        if field == "none":
            return found
        x, y = ((place - self.centre) / self.scale).T
        found[:, :PLANE] = np.array([x, y]).T
        if field == "bowl":
            # Halves of r² − 2, r² cos 2θ and r² sin 2θ: at one scale a bowl is half as high as a
            # plane, and no axis of the chip is preferred
            bowl = [(x**2 + y**2 - 2) / 2, (x**2 - y**2) / 2, x * y]
            found[:, PLANE:] = np.array(bowl).T
        return found

    @property
    def fields(self) -> tuple[str, ...]:
        """Forms of the variation that the places allow: without places, none."""
        return FIELDS if np.isfinite(self.values.place).all() else FIELDS[:1]

    @cached_property
    def means(self) -> Array:
        """Features of the groups' means, (groups, k), their prior standard deviation in them."""
        if self.factors is not None:
            return self.factors
        count = int(self.values.group.max()) + 1
        return MEAN_SD * self.unit * np.eye(count)[:, self.values.groups]

    def features(self, of: Values) -> Array:
        """Return U of entries, (n, r): means of groups, then terms of the variation."""
        means = np.zeros((len(of.y), self.means.shape[1]))
        known = of.group < len(self.means)
        means[known] = self.means[of.group[known]]
        return np.hstack([means, self.terms(of.place, self.fields[-1])])

    @cached_property
    def scales(self) -> Scales:
        """Every form and scale that is summed over."""
        several = len(np.unique(self.values.device)) < len(self.values.y)
        return grid(self.fields, several, self.unit, self._rest)

    @cached_property
    def _rest(self) -> float:
        """What devices differ by beside the bowl that most of them lie on, over the unit.

        1 for few devices, which leave nothing beside a bowl by chance.
        """
        v = self.values
        free = TERMS + len(v.groups)
        if len(self.fields) == 1 or min(len(self.devices), len(v.y) - free) < max(ENOUGH, free):
            return 1.0
        own = (v.group[:, None] == v.groups).astype(float)
        columns = np.hstack([own, self.terms(v.place)])
        off = v.y - self.reference(v)
        left = least_absolute(columns, off / self.unit)
        return float(np.clip(MAD * np.median(left), LEAST_SHARE, 1.0))

    @cached_property
    def prior_sd(self) -> Array:
        """Prior standard deviations d of the features, (scales, r)."""
        s = self.scales
        count = self.means.shape[1]
        found = np.ones((len(s.field), count + TERMS))
        terms = {"none": 0, "plane": PLANE, "bowl": TERMS}
        for k, (field, amplitude) in enumerate(zip(s.field, s.amplitude, strict=True)):
            own = np.arange(TERMS) < terms[field]
            found[k, count:] = amplitude * own
        return found

    @cached_property
    def devices(self) -> Integers:
        """Numbers of the devices, in the order of the sums."""
        return np.unique(self.values.device)

    @cached_property
    def sums(self) -> Sums:
        """Sums over the entries of each device."""
        v = self.values
        pairs = {int(k): i for i, k in enumerate(self.scales.noise)}
        first = [pairs[k] for k in range(len(pairs))]
        return sums_of(
            v,
            v.y - self.reference(v),
            self.features(v),
            self.scales.spread[first],
            self.scales.mode_spread[first],
        )

    def reference(self, of: Values) -> Array:
        """Return what y of entries is counted from.

        The median of their group, of their own where the data have none of it, or of all data
        where groups share factors.
        """
        v = self.values
        found = np.full(len(of.y), np.median(v.y))
        if self.factors is None:
            for g in of.groups:
                seen = v.y[v.group == g]
                found[of.group == g] = np.median(seen if seen.size else of.y[of.group == g])
        return found

    def _unseen(self, of: Values) -> Array:
        """Return the prior variance of the means of groups that the data have none of, (n,)."""
        if self.factors is not None:
            return np.zeros(len(of.y))
        return np.where(np.isin(of.group, self.values.groups), 0.0, (MEAN_SD * self.unit) ** 2)

    def _solve(self, sums: Sums) -> "Solved":
        """Return weights of features and log p(y) for every scale, by sums over devices."""
        k = self.scales.noise
        d = self.prior_sd
        information = sums.information[k]
        projection = d * sums.projection[k]
        precision = np.eye(d.shape[1]) + d[:, :, None] * information * d[:, None, :]
        covariance = np.linalg.inv(precision)
        mean = np.einsum("kab,kb->ka", covariance, projection)
        square = sums.square[k] - np.einsum("ka,ka->k", projection, mean)
        log_determinant = sums.log_determinant[k] - np.linalg.slogdet(precision)[1]
        log_likelihoods = 0.5 * (log_determinant - square - sums.count * LOG2PI)
        return Solved(mean, np.asarray(covariance, float), log_likelihoods)

    @cached_property
    def solved(self) -> "Solved":
        """Weights of features and log p(y) for every scale, by all devices."""
        return self._solve(self.sums.total)

    @cached_property
    def log_evidence(self) -> float:
        """Log p(y), all scales and forms summed over."""
        return float(logsumexp(self.solved.log_likelihoods + self.scales.log_prior))

    @cached_property
    def weights(self) -> Array:
        """Posterior probability of every scale."""
        return np.exp(self.solved.log_likelihoods + self.scales.log_prior - self.log_evidence)

    def probability(self, field: str) -> float:
        """Posterior probability of a form of the variation."""
        return float(self.weights[np.array(self.scales.field) == field].sum())

    def spread(self) -> tuple[float, float]:
        """Return the spread from device to device, and its standard deviation."""
        each = np.hypot(self.scales.spread, self.scales.mode_spread)
        mean = float(self.weights @ each)
        return mean, float(np.sqrt(max(self.weights @ each**2 - mean**2, 0.0)))

    @property
    def scatter(self) -> tuple[float, float]:
        """Spread of all modes of a device together, and between its modes, relative."""
        squares = self.weights @ np.stack([self.scales.spread, self.scales.mode_spread], 1) ** 2
        together, between = np.sqrt(squares)
        return float(together), float(between)

    def expected(self, features: Array) -> "Mixture":
        """Return what sums of features are, given the data. features: (n, r)."""
        return self._expected(self.solved, features, self.weights)

    def _expected(self, solved: "Solved", features: Array, weights: Array) -> "Mixture":
        scaled = features[None] * self.prior_sd[:, None, :]
        mean = np.einsum("kna,ka->kn", scaled, solved.mean)
        variance = np.einsum("kna,kab,knb->kn", scaled, solved.covariance, scaled)
        return Mixture(np.repeat(weights[:, None], len(features), axis=1), mean, variance)

    def over_chip(self, place: Array) -> "Mixture":
        """Return the smooth variation at places, against its mean over the devices."""
        first = [np.flatnonzero(self.values.device == d)[0] for d in self.devices]
        return self.expected(self.variation(place, self.values.place[first].mean(axis=0)[None]))

    def variation(self, place: Array, against: Array) -> Array:
        """Return the features of the variation at places, less those at other places."""
        form = self.fields[-1]
        terms = self.terms(place, form) - self.terms(against, form)
        return np.hstack([np.zeros((len(place), self.means.shape[1])), terms])

    def predict(self, new: Values) -> "Mixture":
        """Predict y of new entries, with their own measurement errors.

        New entries are of devices that are not in the data, each with its own deviation.
        """
        return self._predicted(self.solved, new, self.weights)

    def _predicted(self, solved: "Solved", new: Values, weights: Array) -> "Mixture":
        found = self._expected(solved, self.features(new), weights)
        apart = new.sd**2 + self._unseen(new)
        own = (self.scales.spread**2 + self.scales.mode_spread**2)[:, None] + apart
        return Mixture(found.weights, self.reference(new) + found.means, found.variances + own)

    def log_density(self, new: Values, wider: float = 0.0) -> float:
        """Return the joint log density of all entries of one new device at its own y.

        Args: wider: standard deviation by which the device's own deviation, common to its entries,
            may be larger than the spread.
        """
        solved = self.solved
        scales = self.scales
        n = len(new.y)
        scaled = self.features(new)[None] * self.prior_sd[:, None, :]
        off = new.y - self.reference(new) - np.einsum("kna,ka->kn", scaled, solved.mean)
        known = np.einsum("kna,kab,kmb->knm", scaled, solved.covariance, scaled)
        apart = (scales.mode_spread**2)[:, None] + new.sd**2 + self._unseen(new)
        common = (scales.spread**2 + wider**2)[:, None, None]
        covariance = known + common + apart[:, :, None] * np.eye(n)
        square = np.einsum("kn,kn->k", off, np.linalg.solve(covariance, off[:, :, None])[:, :, 0])
        log_each = -0.5 * (square + np.linalg.slogdet(covariance)[1] + n * LOG2PI)
        return float(logsumexp(np.log(np.maximum(self.weights, TINY)) + log_each))

    @cached_property
    def left_out(self) -> "Mixture":
        """Predict y of each device by all others, with the weights that those give."""
        v = self.values
        shape = (len(self.scales.field), len(v.y))
        found = Mixture(np.empty(shape), np.empty(shape), np.empty(shape))
        for n, device in enumerate(self.devices):
            own = v.device == device
            solved = self._solve(self.sums.without(n))
            log_weights = solved.log_likelihoods + self.scales.log_prior
            weights = np.exp(log_weights - logsumexp(log_weights))
            one = self._predicted(solved, v.only(own), weights)
            found.weights[:, own] = one.weights
            found.means[:, own] = one.means
            found.variances[:, own] = one.variances
        return found


@dataclass(frozen=True)
class Solved:
    """Weights of features given data, for every scale, in their prior standard deviations.

    mean: (scales, r). covariance: (scales, r, r). log_likelihoods: log p(y), (scales,).
    """

    mean: Array
    covariance: Array
    log_likelihoods: Array


def hierarchy(values: Values, unit: float | None = None, factors: Array | None = None) -> Hierarchy:
    """Return the model of some entries; unit: what scales are counted in, by default their own."""
    first = [np.flatnonzero(values.device == d)[0] for d in np.unique(values.device)]
    places = values.place[first]
    centre = places.mean(axis=0)
    scale = float(np.sqrt(((places - centre) ** 2).sum(axis=1).mean() / 2)) or 1.0
    return Hierarchy(values, centre, scale, unit or values.unit, factors)
