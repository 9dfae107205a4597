"""What of a response is compared with the model, in standard deviations.

Complex value, magnitude, phase, or phase modulo π.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import i0e, i1e

from femnl.core.choices import Use
from femnl.observe.response.branches import STIFFEN, ResponseBranches, fold, jacobian, response
from femnl.observe.response.sweeps import Array, Complex, Index, Sweeps
from femnl.observe.response.theta import Layout

# Phases of points weaker than this many standard deviations are far from normal, and are left out.
WEAKEST = 4.0


@dataclass(frozen=True)
class Jump:
    """A sweep jumps before the point `point`, from one fold.

    The top fold of the high branch, or the fold of the low one.
    """

    point: int
    top: bool


@dataclass
class Misfit:
    """Residuals of one fit.

    What depends on the model but must not be bent by it is set by `assign` and fixed in
    between.

    strict: use only states that exist, else also the continuation of a branch past its fold. high
    (n,): the branch of each point, 0 low, 1 high. spread (n,): standard deviation of |V|/σ, less
    than 1 for weak signals. jumps: see below.

    A sweep of known direction has at most one jump, so its branch changes once, where the data say;
    points of sweeps without a direction take the better branch each. In magnitudes alone, the high
    state hardly depends on w but for where it ends, so there the jump is taken to be at the fold,
    within the step between two points.
    """

    sweeps: Sweeps
    layout: Layout
    use: Use
    high: Index
    spread: Array
    strict: bool = False
    jumps: tuple[Jump, ...] = ()
    last: tuple[bytes, Complex, ResponseBranches] | None = None

    @classmethod
    def of(cls, sweeps: Sweeps, layout: Layout, use: Use) -> "Misfit":
        """Start with every point on the low branch."""
        return cls(
            sweeps,
            layout,
            use,
            np.zeros(len(sweeps.voltage), dtype=np.intp),
            np.ones(len(sweeps.voltage)),
        )

    def assign(self, theta: Array) -> bool:
        """Choose the branch of each point; return whether any choice changed."""
        voltage, both = self._response(theta)
        cost = np.array([np.sum(self._compare(v) ** 2, axis=0) for v in voltage])
        better = np.where(both.x[0] == both.x[1], self.high, cost[1] < cost[0]).astype(np.intp)
        stiffening = theta[2] >= 0
        jumps = []
        for span, direction in zip(self.sweeps.spans, self.sweeps.direction, strict=True):
            if direction and span.stop > span.start:
                # With stiffening the high state lies at low frequencies: high up to the jump, low
                # from there.
                first, last = (1, 0) if stiffening else (0, 1)
                gain = cost[first, span] - cost[last, span]
                jump = int(np.argmin(np.concatenate([[0.0], np.cumsum(gain)])))
                better[span] = np.where(np.arange(len(gain)) < jump, first, last)
                here = span.start + jump
                around = slice(here - 1, here + 1)
                # A jump between two readings at one frequency says nothing of where the fold lies
                if (
                    0 < jump < len(gain)
                    and np.any(both.x[0, around] != both.x[1, around])
                    and np.ptp(self.sweeps.frequency[around]) > 0
                ):
                    jumps.append(Jump(here, top=(direction > 0) == stiffening))
        changed = bool(np.any((better != self.high) & (both.x[0] != both.x[1])))
        self.high = better
        if self.use == "magnitude":
            self.jumps = () if self.layout.damping else tuple(jumps)
            self.spread = rice(np.abs(voltage[better, np.arange(len(better))]) / self.sweeps.noise)[
                1
            ]
        return changed

    def residual(self, theta: Array) -> Array:
        """Return the residuals in standard deviations, (n,), or (2n,) for complex data."""
        voltage, _ = self._response(theta)
        points = self._compare(voltage[self.high, np.arange(voltage.shape[1])]).ravel()
        return np.concatenate([points, [self._jump(theta, jump)[0] for jump in self.jumps]])

    def cost(self, theta: Array) -> float:
        """Return χ² with the states that suit θ best."""
        self.assign(theta)
        return float(np.sum(self.residual(theta) ** 2))

    def jacobian(self, theta: Array, *, cautious: bool = False) -> Array:
        """Return the derivatives of `residual` by θ, `cautious` near folds for a covariance."""
        voltage, both = self._response(theta)
        v = voltage[self.high, np.arange(voltage.shape[1])]
        points = self._project(
            v, jacobian(self.sweeps, self.layout, theta, both, self.high, cautious=cautious)
        )
        return np.vstack([points, *(self._jump(theta, jump)[1] for jump in self.jumps)])

    def _response(self, theta: Array) -> tuple[Complex, ResponseBranches]:
        """Return both branches.

        Residual, Jacobian and choice of states ask for the same θ in turn.
        """
        key = theta.tobytes()
        if self.last is None or self.last[0] != key:
            self.last = key, *response(self.sweeps, self.layout, theta, continued=not self.strict)
        return self.last[1:]

    @property
    def folded(self) -> bool:
        """Whether any point of the last response has two states, or had them on the way."""
        return self.last is not None and bool(np.any(self.last[2].x[0] != self.last[2].x[1]))

    def past_fold(self, theta: Array) -> int:
        """Count the points whose state is the continuation of a branch past its fold."""
        if self.strict:
            return 0
        _, both = self._response(theta)
        return int(np.count_nonzero(both.pair[self.high, np.arange(len(self.high))]))

    def real_state(self, theta: Array) -> tuple[Complex, ResponseBranches]:
        """Return the voltage of the chosen states, and the branches.

        The only root where the chosen branch has ended.
        """
        voltage, both = response(self.sweeps, self.layout, theta, continued=True)
        points = np.arange(voltage.shape[1])
        chosen = np.where(both.pair[self.high, points], 1 - self.high, self.high)
        return voltage[chosen, points], both

    def _jump(self, theta: Array, jump: Jump) -> tuple[float, Array]:
        """Return how far the fold is from where the sweep jumped, in standard deviations.

        The fold is that of the reduced balance at the jump, (f₀² − f²)/(f w) = δ; its
        derivatives are those of a high Q.
        """
        f0, w, ratio, *_ = self.layout.split(theta)
        before, after = self.sweeps.frequency[jump.point - 1 : jump.point + 1]
        power = self.sweeps.drive[jump.point] ** 2 * (2 * f0 / (before + after)) ** 3
        delta, x = fold(STIFFEN * ratio * power, top=jump.top)
        slopes = np.zeros(self.layout.size)
        slopes[:3] = self.layout.width, -w * delta / 2, w * x / 2 * STIFFEN * power
        lies = np.hypot(f0, w * delta / 2) - w * delta / 2
        # The fold lies anywhere between two points: so many of their distance hold 68 %.
        sd = 0.341 * (after - before)
        return float((lies - (before + after) / 2) / sd), slopes / sd

    def _compare(self, model: Complex) -> Array:
        data = self.sweeps.voltage
        noise = self.sweeps.noise
        if self.use == "complex":
            return np.stack([data.real - model.real, data.imag - model.imag]) / noise
        if self.use == "magnitude":
            return np.asarray(
                ((np.abs(data) / noise - rice(np.abs(model) / noise)[0]) / self.spread)[None]
            )
        angle = (
            np.angle(data * model.conj())
            if self.use == "phase"
            else np.angle((data * model.conj()) ** 2) / 2
        )
        return np.asarray((angle * np.abs(data) / noise)[None])

    def _project(self, model: Complex, slopes: Complex) -> Array:
        data = self.sweeps.voltage
        noise = self.sweeps.noise
        if self.use == "complex":
            return np.concatenate([slopes.real, slopes.imag]) / -noise
        relative = slopes / model[:, None]
        if self.use == "magnitude":
            size = np.abs(model) / noise
            return np.asarray(-(rice(size)[2] * size / self.spread)[:, None] * relative.real)
        return np.asarray(-(np.abs(data) / noise)[:, None] * relative.imag)


def rice(size: Array) -> tuple[Array, Array, Array]:
    """Return mean and standard deviation of |V|/σ, and the derivative of the mean.

    The argument `size` is the noiseless |V|/σ. The mean is √(π/2) L½(−size²/2): noise lifts a weak
    magnitude.

    Source: Rice (1945), Bell System Technical Journal 24, 46, section 3.10.
    """
    half = size**2 / 4
    bessel0 = i0e(half)
    bessel1 = i1e(half)
    mean = np.sqrt(np.pi / 2) * ((1 + 2 * half) * bessel0 + 2 * half * bessel1)
    growth = np.sqrt(np.pi / 2) * size / 2 * (bessel0 + bessel1)
    # Beyond this the difference of large numbers loses digits; there the variance is 1 − 1/(2
    # size²).
    variance = np.where(size > 100, 1 - 0.5 / np.maximum(size, 1) ** 2, size**2 + 2 - mean**2)
    return np.asarray(mean), np.asarray(np.sqrt(variance)), np.asarray(growth)


def usable(sweeps: Sweeps, use: Use) -> NDArray[np.bool_]:
    """Tell which points a fit may use."""
    if use in ("phase", "phase-mod-pi"):
        return np.asarray(np.abs(sweeps.voltage) > WEAKEST * sweeps.noise)
    return np.ones(len(sweeps.voltage), dtype=bool)
