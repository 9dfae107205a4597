"""Least squares with numerical tangents, evidence by Laplace's method, cross-validation."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from femnl.core.checkpoint import Checkpoint
from femnl.core.readout import Array
from femnl.fits.recall import recalled
from femnl.fits.tangents import jacobian_at, steps_for
from femnl.observe.extended import ExtendedModel

DECADES = 1e6
"""Ratio of the largest to the smallest strength that an effect may have."""
AT_BOUND = 1e-6
"""Distance from its bound, in standard deviations, up to which a result counts as stuck there. In
parts of the range it would depend on how wide that is: a pressure of 0.2 µPa known to 15 % is not
at its bound of 0 because 500 Pa are allowed.
"""

BESIDE = 1e-4
PUSHED = 2.0
"""Distance from a bound, in parts of the range, and σ by which the data push beyond it, from which
on a parameter is stuck there.
"""
LOOSE = 0.05
"""Part of its range below which the data know a parameter that shapes an effect."""
ITERATIONS = 12
"""Iterations of the fits that leave a block out; they start at the whole fit."""
LONG = 20_000
"""Residuals beyond which derivatives are kept in single precision."""


@dataclass(frozen=True)
class CrossValidation:
    """Prediction of data that no fit has seen.

    χ² per datum, logarithms of the densities that fits without each block predict for it.

    A cause that acts on one block alone, as a frame does on one mode, is uncertain there without
    it, and not wrong: densities and p_value, the smallest of any block times their number, count
    how uncertain the prediction is, chi2_reduced does not. squares, sizes: χ² and number of data of
    each block.
    """

    chi2_reduced: float
    densities: tuple[float, ...]
    p_value: float
    squares: tuple[float, ...]
    sizes: tuple[int, ...]

    @property
    def density(self) -> float:
        """Logarithm of the density of all blocks."""
        return sum(self.densities)


@dataclass(frozen=True)
class FitResult:
    """A fitted model.

    vector (p,), residuals (n,), slopes (n, p) as `stored` keeps them, covariance with the priors'
    ranges (p, p). checkpoint: keeps this fit, and those that start from it.
    """

    model: ExtendedModel
    vector: Array
    residuals: Array
    slopes: NDArray[np.floating]
    covariance: Array
    checkpoint: Checkpoint | None = None

    @property
    def jacobian(self) -> Array:
        """Derivatives (n, p) of the residuals."""
        return np.asarray(self.slopes, dtype=np.float64)

    @property
    def chi2(self) -> float:
        """χ², prior knowledge included."""
        return float(self.residuals @ self.residuals)

    @property
    def degrees(self) -> int:
        """Degrees of freedom left."""
        return max(len(self.residuals) - self.vector.size, 1)

    @property
    def log_evidence(self) -> float:
        """Return the logarithm of ∫ likelihood × prior by Laplace's method.

        It is counted up to a constant that all models of the measurement share.

        Base parameters have uniform priors, so that only their widths enter, which cancel unless an
        effect replaces them. How strong an effect is, is not known even to the order of magnitude:
        half of the prior of a strength is uniform in its logarithm over the decades of `DECADES`,
        or else the widest range that anyone cares to allow would decide between weak causes.
        """
        _, log_volume = np.linalg.slogdet(self.covariance)
        peak = -self.chi2 / 2 + log_prior(
            self.model, self.vector, np.sqrt(np.diag(self.covariance))
        )
        return float(peak + 0.5 * (self.vector.size * np.log(2 * np.pi) + log_volume))

    @cached_property
    def cross_validation(self) -> CrossValidation:
        """How fits like this one predict data that they have not seen."""
        return cross_validate(self, ITERATIONS)

    @property
    def predicted(self) -> bool:
        """Whether `cross_validation` is known already."""
        return "cross_validation" in vars(self)

    def keep_predicted(self, cross_validation: CrossValidation) -> None:
        """Keep what another process has found of how fits like this one predict."""
        vars(self)["cross_validation"] = cross_validation

    @property
    def free(self) -> NDArray[np.bool_]:
        """Which parameters (p,) did not end at a bound, and can still take up deviations."""
        low, high = self.model.bounds
        near = AT_BOUND * np.sqrt(np.diag(self.covariance))
        return np.asarray((self.vector - low >= near) & (high - self.vector >= near))

    @cached_property
    def _push(self) -> Array:
        """By how many σ the data push each parameter (p,) up, or down where below 0.

        Its square is what χ² would fall by if the parameter had no bound.
        """
        return np.asarray(-(self.jacobian.T @ self.residuals) * np.sqrt(np.diag(self.covariance)))

    @property
    def stuck(self) -> list[str]:
        """Names of the effects' parameters that ended at a bound, or that the data push there.

        A shape that the data hardly know may end anywhere, but not where χ² would fall clearly
        beyond its bound.
        """
        low, high = self.model.bounds
        sd = np.sqrt(np.diag(self.covariance))
        push = self._push
        beside = np.where(push > 0, high - self.vector, self.vector - low) < BESIDE * (high - low)
        pushed = beside & (np.abs(push) > PUSHED)
        found = zip(
            self.model.parameters, self.free, sd < LOOSE * (high - low), pushed, strict=True
        )
        return [
            f"{owner}.{spec.name}"
            for (owner, spec), f, k, p in found
            if owner != "base" and (p or (not f and (spec.strength or k)))
        ]

    @property
    def allowed(self) -> list[str]:
        """Names of those of `stuck` that are as likely within their bound.

        The data push a strength beyond its largest value by less than its uncertainty.
        """
        stuck = self.stuck
        values = zip(self.model.parameters, self.vector, self._push, strict=True)
        return [
            name
            for (owner, spec), value, push in values
            if (name := f"{owner}.{spec.name}") in stuck
            and spec.strength
            and value != 0
            and abs(push) < 1
        ]


def log_prior(model: ExtendedModel, vector: Array, sd: Array) -> float:
    """Return the logarithm of the density of all priors at a vector.

    A strength counts as no smaller than its sd.
    """
    low, high = model.bounds
    total = 0.0
    for (owner, spec), value, s, a, b in zip(model.parameters, vector, sd, low, high, strict=True):
        density = 1 / (max(value, a) * np.log(b / a)) if spec.log else 1 / (b - a)
        if spec.strength and owner != "base" and not spec.log:
            sides = 2 if a < 0 < b else 1
            density = 0.5 / (b - a) + 0.5 / (sides * max(abs(value), s) * np.log(DECADES))
        total += float(np.log(density))
    return total


def fit(
    model: ExtendedModel,
    start: Array,
    keep: NDArray[np.bool_] | None = None,
    most: int = 100,
    near: FitResult | None = None,
    *,
    worth: float = np.inf,
    checkpoint: Checkpoint | None = None,
) -> FitResult:
    """Minimise χ² from a start.

    With `keep` (n_residuals,) the sum runs only over those residuals, though all are returned.

    most: evaluations. near: a solution with parameters of this model, whose tangents tell what
    steps suit them, and whose checkpoint keeps this fit too. worth: χ² above which a fit ends once
    it gains little. checkpoint: of a first fit.
    """
    if near is not None:
        checkpoint = near.checkpoint
    asked = (keep, most, worth)
    end, steps = recalled(model, start, asked, _first_steps(model, near), checkpoint)
    return _ended(model, end, steps, checkpoint)


def _ended(
    model: ExtendedModel, end: Array, steps: Array, checkpoint: Checkpoint | None
) -> FitResult:
    """Return the result of a fit that ended somewhere, with derivatives of the given steps."""
    at = model.residuals(end)
    slopes = jacobian_at(model, end, at, steps)
    low, high = model.bounds
    return FitResult(model, end, at, stored(slopes), covariance(slopes, high - low), checkpoint)


def stored(slopes: Array) -> NDArray[np.floating]:
    """Return derivatives (n, p) as a fit keeps them.

    Dozens of fits of a large map would take half a gigabyte. Derivatives by differences are right
    to some 1e-6, single precision to 1e-7. What it cannot hold stays as it is.
    """
    if len(slopes) <= LONG:
        return slopes
    with np.errstate(over="ignore"):
        lean = slopes.astype(np.float32)
    return lean if np.isfinite(lean).all() else slopes


def improve(model: ExtendedModel, start: Array, most: int, near: FitResult) -> tuple[float, Array]:
    """Return χ² and the vector of a fit that is only to be ranked and continued."""
    first = _first_steps(model, near)
    end, _ = recalled(model, start, (None, most, np.inf), first, near.checkpoint)
    return float(np.sum(model.residuals(end) ** 2)), end


def _first_steps(model: ExtendedModel, near: FitResult | None) -> Array:
    """Return steps for tangents at the start of a fit.

    Parameters that a solution nearby has, too, take its steps.
    """
    sizes: dict[tuple[str, str], float] = {}
    if near is not None:
        norms = np.linalg.norm(near.jacobian, axis=0)
        sizes = {
            (owner, spec.name): float(norm)
            for (owner, spec), norm in zip(near.model.parameters, norms, strict=True)
        }
    return steps_for(
        model, np.array([sizes.get((owner, spec.name), 0.0) for owner, spec in model.parameters])
    )


def covariance(slopes: Array, width: Array) -> Array:
    """Return the covariance of the parameters.

    Its inverse is their Fisher information plus that of their uniform priors, 12/width².
    """
    # By singular values: a Fisher matrix would square what the strongest direction exceeds the
    # weakest by, and drown the prior's 12.
    _, size, turned = np.linalg.svd(np.linalg.qr(slopes * width, mode="r"))
    spread = turned.T / np.sqrt(np.pad(size, (0, width.size - size.size)) ** 2 + 12)
    return np.asarray(spread @ spread.T * np.outer(width, width))


def held_out(result: FitResult, most: int) -> float:
    """Return χ² per datum of all blocks, each predicted by a fit to the others.

    Prior knowledge is never left out.
    """
    model = result.model
    blocks = result.model.base_model.blocks
    square = 0.0
    for block in np.unique(blocks[blocks >= 0]):
        end, _ = _without(result, blocks == block, most)
        square += float(np.sum(model.residuals(end)[blocks == block] ** 2))
    return square / int(np.sum(blocks >= 0))


def _without(result: FitResult, out: NDArray[np.bool_], most: int) -> tuple[Array, Array]:
    """Return where a fit without some residuals ends, and its steps.

    It begins where that to all of them ended, with the derivatives that are known there.
    """
    asked = (~out, most, np.inf)
    first = _first_steps(result.model, result)
    return recalled(
        result.model, result.vector, asked, first, result.checkpoint, known=result.jacobian
    )


def cross_validate(result: FitResult, most: int) -> CrossValidation:
    """Predict each block of the data by a fit to the others; prior knowledge is never left out.

    ln p(block | others) is by how much the logarithm of evidence falls from the others to all data:
    −½ of what χ² gains, and −½ of what ln|C| loses, C the covariance of the parameters. Where the
    model is linear over the errors that the fit to the others leaves, these are rᵀ S⁻¹ r and ln|S|,
    S = 1 + J C Jᵀ; where it bends over them, S, which knows one slope, would mistake that for a
    misfit. What the block's own noise adds to χ², which no parameters could follow, says nothing of
    how it is predicted; the rest, by which the block and the others want other parameters (G. C.
    Chow, Econometrica 28, 591 (1960)), has as many degrees of freedom as parameters that the block
    tells.
    """
    blocks = result.model.base_model.blocks
    low, high = result.model.bounds
    units = np.outer(high - low, high - low)
    squares = []
    sizes = []
    densities = []
    p_values = []
    for block in np.unique(blocks[blocks >= 0]):
        out = blocks == block
        other = _ended(result.model, *_without(result, out, most), result.checkpoint)
        seen = other.residuals[~out]
        cross_validation = other.residuals[out]
        known = covariance(other.jacobian[~out], high - low)
        gained = (
            np.linalg.slogdet(known / units)[1] - np.linalg.slogdet(result.covariance / units)[1]
        )
        chi2 = max(result.chi2 - float(seen @ seen), 0.0)
        squares.append(float(cross_validation @ cross_validation))
        sizes.append(len(cross_validation))
        densities.append(-0.5 * (chi2 + float(gained)))
        left, size, _ = np.linalg.svd(result.jacobian[out] * (high - low), full_matrices=False)
        known = left[:, size > np.sqrt(12)]  # better than the priors do
        own = result.residuals[out] - known @ (known.T @ result.residuals[out])
        p_values.append(float(chdtrc(max(known.shape[1], 1), max(chi2 - float(own @ own), 0.0))))
    return CrossValidation(
        sum(squares) / sum(sizes),
        tuple(densities),
        min(1.0, min(p_values) * len(p_values)),
        tuple(squares),
        tuple(sizes),
    )
