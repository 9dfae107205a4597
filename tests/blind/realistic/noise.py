"""Noise as it is: correlated, larger or smaller than stated, with glitches; and what is unknown."""

from typing import Any

import numpy as np
from scipy.signal import lfilter

from tests.blind.lab.bench import Array
from tests.blind.lab.decay import STEPS
from tests.blind.realistic.regimes import Options

PAIRED = ("response", "map", "decay")
"""Kinds whose data are complex: a glitch is in both quadratures."""
BEFORE_FILTER = "decay"
"""The kind whose noise, and so its glitches, go through a filter; other noise of it is a gain's."""


class RealNoise:
    """What a bench takes for noise in units of the stated σ; see `bench.Noise`.

    more: what is unknown, in the stated σ, added where noise is first asked for. glitches: σ of
    each, true ones.
    """

    def __init__(
        self, kind: str, options: Options, rng: np.random.Generator, more: Array | None = None
    ) -> None:
        self.kind = kind
        self.options = options
        self.rng = rng
        self.more = more
        self.glitches: list[float] = []

    def standard_normal(self, size: Any, /) -> Any:
        """Return noise of that shape, correlated along its last axis."""
        noise = correlated(self.rng.standard_normal(size), self.options.correlation)
        if self.options.glitches and not (self.kind == BEFORE_FILTER and self.glitches):
            self._hit(noise)
        noise = noise / self.options.stated
        if self.more is not None:
            noise = noise + self.more.reshape(noise.shape)
            self.more = None
        return noise

    def _hit(self, noise: Array) -> None:
        """Add glitches at random points."""
        paired = self.kind in PAIRED
        flat = noise.reshape(2 if paired else 1, -1)
        points = flat.shape[1] // (STEPS if self.kind == BEFORE_FILTER else 1)
        count = max(1, round(self.options.glitches * points))
        where = self.rng.choice(flat.shape[1], count, replace=False)
        low, high = np.log(self.options.glitch_size)
        size = np.exp(self.rng.uniform(low, high, count))
        turn = self.rng.uniform(-np.pi, np.pi, count)
        if paired:
            flat[:, where] += size * np.array([np.cos(turn), np.sin(turn)])
        else:
            flat[0, where] += size * np.sign(turn)
        self.glitches += [float(s) for s in size]


def correlated(white: Array, neighbours: float) -> Array:
    """Return noise of variance 1 with that correlation between neighbours, from white noise.

    x_k = c x_{k−1} + √(1 − c²) w_k along the last axis, x_0 = w_0.
    """
    if neighbours == 0:
        return white
    kept = np.sqrt(1 - neighbours**2)
    driven = kept * white
    driven[..., 0] = white[..., 0]
    return np.asarray(lfilter([1.0], [1.0, -neighbours], driven, axis=-1))
