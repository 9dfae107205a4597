"""What the photodiode gives when the film is displaced by u.

Sinusoidal fringe, multilayer reflection, power series.

Every fringe is a plain callable u [m] → v [V]. Positive u moves the film away from the wafer, so
the gap becomes gap + u. Time runs as exp(+iωt): refractive indices of absorbing layers are n − ik,
as the paper prints them.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from tmm import coh_tmm

from femnl.core.device import Stack
from femnl.core.errors import ConvergenceError, ParameterError
from femnl.core.readout import Array, FourierSeries
from femnl.optics.airy import index_of

SAMPLES = 64
"""First number of samples of a period of R(u); doubled until the series has converged."""
FLOOR = 1e-14
"""Overtones weaker than this part of the strongest are rounding and are dropped."""


@dataclass(frozen=True)
class SineFringe:
    """The sinusoidal fringe f(u) = V₀ + V_C cos(4πu/λ + θ).

    Args:
        wavelength: λ [m].
        offset: V₀ [V].
        contrast: V_C [V].
        phase: θ [rad], the working point at u = 0.

    Valid: weak reflections; the stack of the source paper has a second overtone of 23 % (633 nm)
    and 37 % (532 nm).
    Source: Sommer et al. 2025, supplement S7, sinusoidal fringes.
    """

    wavelength: float
    offset: float
    contrast: float
    phase: float

    def __post_init__(self) -> None:
        _positive("wavelength", self.wavelength)

    def __call__(self, u: ArrayLike) -> Array:
        """Return f(u) [V] at displacements u [m]."""
        return np.asarray(
            self.offset
            + self.contrast
            * np.cos(4 * np.pi * np.asarray(u, float) / self.wavelength + self.phase)
        )

    @property
    def fourier(self) -> FourierSeries:
        """Fourier series of f: c₀ = V₀, c₁ = V_C e^{iθ}, period λ/2."""
        return FourierSeries(
            self.wavelength / 2, np.array([self.offset, self.contrast * np.exp(1j * self.phase)])
        )


@dataclass(frozen=True)
class SeriesFringe:
    """The power series f(u) = Σ_m a_m u^m, with a_m = f⁽ᵐ⁾(0)/m! in V/mᵐ.

    Valid: motion well inside one fringe; it diverges from any fringe beyond about λ/4.
    Source: Sommer et al. 2025, supplement S7, power series.
    """

    coefficients: tuple[float, ...]

    def __call__(self, u: ArrayLike) -> Array:
        """Return f(u) [V] at displacements u [m]."""
        return np.asarray(np.polynomial.polynomial.polyval(np.asarray(u, float), self.coefficients))


@dataclass(frozen=True)
class MultilayerFringe:
    """The reflection of the whole stack at normal incidence: f(u) = offset + gain·R(gap + u).

    R depends on the gap only through its round-trip phase e^{−4πi n d/λ}, so with a lossless gap it
    repeats exactly after λ/2n; one period is computed by transfer matrices and kept as a Fourier
    series, which costs about 20 terms an evaluation.

    Args:
        stack: layers with their indices, as `Model.stack` gives them; the first and the last are
            infinite.
        wavelength: λ [m], one of those for which every layer of the stack gives an index.
        gain: volts per unit of reflectivity.
        offset: volts without reflected light.

    Raises:
        ParameterError: no stack, a wavelength that the stack does not list, or a gap that absorbs.

    Valid: plane waves, coherent layers, gap + u > 0 (the film does not touch the wafer). Indices
    are never interpolated.
    Source: Byrnes, tmm; Sommer et al. 2025, supplement S6.
    """

    stack: Stack | None
    wavelength: float
    gain: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        _positive("wavelength", self.wavelength)
        if not 0 < self._layers.gap < len(self._layers.layers) - 1:
            raise ParameterError(
                f"gap = {self._layers.gap} is not an inner layer of the stack of "
                f"{len(self._layers.layers)} layers"
            )
        gap = self._indices[self._layers.gap]
        if gap.imag != 0:
            raise ParameterError(
                f"the gap has the index {gap}: an absorbing gap gives no periodic fringe; use a "
                "real index"
            )

    def __call__(self, u: ArrayLike) -> Array:
        """Return f(u) [V] at displacements u [m]."""
        return self.fourier(u)

    @cached_property
    def fourier(self) -> FourierSeries:
        """Fourier series of f in u, period λ/2n of the gap."""
        period = self.wavelength / (2 * self._indices[self._layers.gap].real)
        n_samples = SAMPLES
        while True:
            reflectance = np.array(
                [self.reflectance(u) for u in period * np.arange(n_samples) / n_samples]
            )
            coefficients = np.fft.rfft(self.offset + self.gain * reflectance) / n_samples
            coefficients[1:] *= 2
            strength = np.abs(coefficients[1:])
            if np.all(strength[-n_samples // 8 :] <= FLOOR * np.abs(coefficients).max()):
                kept = np.flatnonzero(strength > FLOOR * strength.max())
                return FourierSeries(period, coefficients[: kept[-1] + 2])
            if n_samples >= 2**14:
                raise ConvergenceError(
                    f"the fringe at {self.wavelength * 1e9:g} nm needs over {n_samples} samples: "
                    "check the indices"
                )
            n_samples *= 2

    def reflectance(self, u: float) -> float:
        """Return the reflectivity R of the stack with the gap widened by u [m].

        It is computed by transfer matrices.
        """
        thickness = [layer.thickness for layer in self._layers.layers]
        thickness[self._layers.gap] += u
        # tmm counts time as exp(−iωt), where absorption is n + ik.
        indices = [index.conjugate() for index in self._indices]
        return float(coh_tmm("s", indices, thickness, 0.0, self.wavelength)["R"])

    @property
    def _layers(self) -> Stack:
        if self.stack is None:
            raise ParameterError(
                "stack = None: the geometry gives no stack of layers; add [readout] to it, or "
                "take a SineFringe"
            )
        return self.stack

    @cached_property
    def _indices(self) -> tuple[complex, ...]:
        """The index of every layer at the wavelength."""
        return tuple(index_of(layer, self.wavelength) for layer in self._layers.layers)


def _positive(name: str, value: float) -> None:
    """Refuse a value that is not a positive number."""
    if not (np.isfinite(value) and value > 0):
        raise ParameterError(f"{name} = {value} is not a positive length in m")
