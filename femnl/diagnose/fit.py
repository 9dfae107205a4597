"""Least squares with numerical tangents that suit any parameter, evidence by Laplace's method, and held-out prediction."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from femnl.diagnose.problem import Extended
from femnl.types.readout import Array

TARGET = 0.05
"""Change of the whole residual vector, in σ, at which tangents are taken."""
INSIDE = 1e-9
"""Distance from its bounds, in parts of the range, that a start keeps."""
AT_BOUND = 1e-6
"""The same part of the range up to which a result counts as stuck at its bound."""


@dataclass(frozen=True)
class Solution:
    """A fitted model: vector, residuals (n,), jacobian (n, p), covariance with the priors' ranges (p, p)."""

    model: Extended
    vector: Array
    residuals: Array
    jacobian: Array
    covariance: Array

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
        """Logarithm of ∫ likelihood × prior by Laplace's method, up to a constant that all models of the problem share.

        Base parameters have uniform priors, so that only their widths enter, which cancel unless an effect replaces them.
        """
        low, high = self.model.bounds
        width = high - low
        log_prior = 0.0
        for (_, knob), value, w, a, b in zip(self.model.knobs, self.vector, width, low, high, strict=True):
            density = 1 / (max(value, a) * np.log(b / a)) if knob.log else 1 / w
            log_prior += float(np.log(density))
        _, log_volume = np.linalg.slogdet(self.covariance)
        return float(-self.chi2 / 2 + log_prior + 0.5 * (self.vector.size * np.log(2 * np.pi) + log_volume))

    @property
    def stuck(self) -> list[str]:
        """Names of the parameters of effects that ended at a bound."""
        low, high = self.model.bounds
        near = AT_BOUND * (high - low)
        hit = (self.vector - low < near) | (high - self.vector < near)
        return [f"{owner}.{knob.name}" for (owner, knob), h in zip(self.model.knobs, hit, strict=True) if h and owner != "base"]


def tangent_steps(model: Extended, vector: Array, at: Array) -> Array:
    """Return for each parameter a step that changes the residuals by about `TARGET` in all."""
    low, high = model.bounds
    steps = np.empty(vector.size)
    for i, width in enumerate(high - low):
        step = 1e-6 * width
        for _ in range(6):
            change = float(np.linalg.norm(model.residuals(_moved(vector, i, step, low, high)) - at))
            if change > 0.2 * TARGET and change < 5 * TARGET:
                break
            # A jump, as where two modes exchange labels, must not shrink the step to nothing.
            step = float(np.clip(step * np.clip(TARGET / max(change, 1e-300), 1e-4, 1e4), 1e-11 * width, 0.01 * width))
        steps[i] = step
    return steps


def jacobian_at(model: Extended, vector: Array, at: Array, steps: Array) -> Array:
    """Return the derivatives of the residuals, taken away from the nearer bound."""
    low, high = model.bounds
    columns = []
    for i, step in enumerate(steps):
        moved = _moved(vector, i, step, low, high)
        columns.append((model.residuals(moved) - at) / (moved[i] - vector[i]))
    return np.stack(columns, axis=1)


def _moved(vector: Array, i: int, step: float, low: Array, high: Array) -> Array:
    moved = vector.copy()
    moved[i] += step if vector[i] + step <= high[i] else -step
    return moved


def fit(model: Extended, start: Array, keep: NDArray[np.bool_] | None = None, most: int = 60) -> Solution:
    """Minimise χ² from a start; with `keep` (n_residuals,) only over those residuals, though all are returned."""
    low, high = model.bounds
    inside = INSIDE * (high - low)
    vector = np.clip(start, low + inside, high - inside)
    chosen = slice(None) if keep is None else keep
    steps = tangent_steps(model, vector, model.residuals(vector))

    def residuals(v: Array) -> Array:
        return model.residuals(v)[chosen]

    def jacobian(v: Array) -> Array:
        return jacobian_at(model, v, model.residuals(v), steps)[chosen]

    found = least_squares(residuals, vector, jacobian, (low, high), x_scale="jac", xtol=1e-10, ftol=1e-9, gtol=1e-9, max_nfev=most)
    at = model.residuals(found.x)
    slopes = jacobian_at(model, found.x, at, tangent_steps(model, found.x, at))
    return Solution(model, found.x, at, slopes, covariance(slopes, high - low))


def covariance(slopes: Array, width: Array) -> Array:
    """Return the covariance of the parameters from their Fisher information and that of their uniform priors, 12/width²."""
    scaled = slopes * width
    fisher = scaled.T @ scaled + 12 * np.eye(width.size)
    return np.asarray(np.linalg.inv(fisher) * np.outer(width, width))


def held_out(solution: Solution, most: int = 12) -> float:
    """Return χ² per datum of each block predicted by a fit to the others."""
    blocks = solution.model.problem.blocks
    total, count = 0.0, 0
    for block in np.unique(blocks[blocks >= 0]):
        out = blocks == block
        other = fit(solution.model, solution.vector, ~out, most)
        total += float(other.residuals[out] @ other.residuals[out])
        count += int(out.sum())
    return total / count
