"""The vector θ of a driven Duffing mode: which of its numbers is what."""

from dataclasses import dataclass

import numpy as np

from femnl.observe.response.sweeps import Array, Complex

# Of the middle of all frequencies, the lowest f₀ that a step of a fit may try.
LOWEST = 1e-3


@dataclass(frozen=True)
class Layout:
    """Where each parameter stands in the vector θ of a fit.

    θ = ((f₀ − centre)/width, ln(w/width), α_y/α_c at the strongest drive, [d], ln y_max per
    position, φ per position, τ·span, [background]); f₀ and w count from `centre` in units of
    `width` [Hz], y_max in V per `reference` [V] of drive, τ in 1/span [Hz]. y_max is missing in a
    fit to phases, φ and τ in a fit to magnitudes, and d, the nonlinear damping at x = 1, unless
    asked for. The background has `background` complex terms a position, C₀ and C₁·span [V], as
    real and imaginary parts in turn. It grows with the drive where `driven`, and where
    `delayed` the delay turns it as well as the resonance.
    """

    centre: float
    width: float
    span: float
    reference: float
    n_positions: int
    damping: bool
    gain: bool
    phase: bool
    background: int = 0
    driven: bool = False
    delayed: bool = False

    @property
    def gains(self) -> slice:
        """Where ln y_max stands."""
        start = 4 if self.damping else 3
        return slice(start, start + (self.n_positions if self.gain else 0))

    @property
    def phases(self) -> slice:
        """Where φ stands."""
        return slice(self.gains.stop, self.gains.stop + (self.n_positions if self.phase else 0))

    @property
    def delay(self) -> int:
        """Where τ·span stands, or would stand."""
        return int(self.phases.stop)

    @property
    def backgrounds(self) -> slice:
        """Where the background stands: by position, term, and real before imaginary part."""
        start = self.delay + int(self.phase)
        return slice(start, start + 2 * self.background * self.n_positions)

    @property
    def size(self) -> int:
        """How many parameters there are."""
        return int(self.backgrounds.stop)

    def terms(self, theta: Array) -> Complex:
        """Return the background of θ, (n_positions, terms) complex [V]."""
        pairs = theta[self.backgrounds].reshape(self.n_positions, self.background, 2)
        return np.asarray(pairs[..., 0] + 1j * pairs[..., 1])

    def theta_of(self, k: int, value: float) -> float:
        """Return the entry k of θ for a parameter's value in SI."""
        if k == 0:
            return (value - self.centre) / self.width
        if k == 1:
            return float(np.log(max(value, np.finfo(float).tiny) / self.width))
        if self.gains.start <= k < self.gains.stop:
            return float(np.log(max(value * self.reference, np.finfo(float).tiny)))
        if self.phase and k == self.delay:
            return value * self.span
        if k >= self.backgrounds.start:
            slope = (k - self.backgrounds.start) % (2 * self.background) >= 2
            per = self.reference if self.driven else 1.0
            return value * per * (self.span if slope else 1.0)
        return value

    def split(self, theta: Array) -> tuple[float, float, float, float, Array, Array, float]:
        """Return f₀ [Hz], w [Hz], α_y/α_c, d, y_max and φ by position, and τ [s]."""
        gain = (
            np.exp(np.clip(theta[self.gains], -100, 100))
            if self.gain
            else np.ones(self.n_positions)
        )
        phase = theta[self.phases] if self.phase else np.zeros(self.n_positions)
        tau = float(theta[self.delay]) / self.span if self.phase else 0.0
        damping = float(theta[3]) if self.damping else 0.0
        # A step of a fit may go anywhere; beyond these the arithmetic overflows.
        w = self.width * float(np.exp(np.clip(theta[1], -25, 25)))
        ratio = float(np.clip(theta[2], -1e6, 1e6))
        f0 = self.centre + self.width * float(np.clip(theta[0], -1e6, 1e6))
        return (
            max(f0, LOWEST * self.centre),
            w,
            ratio,
            damping,
            gain,
            phase,
            tau,
        )
