"""What the optical readout hands on: periodic fringes as Fourier series, and maps of harmonics.

Amplitudes everywhere: v(t) = Σ_n Re(V_n e^{inωt}), so |V_n| = 2|v_n| with v_n the two-sided Fourier
coefficient; V_0 = v_0.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from femnl.core.arrays import freeze
from femnl.core.kinds import function
from femnl.core.numbers import micrometres, with_error
from femnl.core.tables import Table, Tabulated

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True)
class FourierSeries:
    """A periodic function of displacement.

    f(u) = Re Σ_{k≥0} c_k e^{2πiku/Λ}, with the period Λ [m] and c_k (n_overtones + 1,) [V].
    """

    period: float
    coefficients: ComplexArray

    def __post_init__(self) -> None:
        freeze(self)

    def __call__(self, u: ArrayLike) -> Array:
        """Return f(u) [V] at displacements u [m] of any shape."""
        turn = np.exp(2j * np.pi * np.asarray(u, float) / self.period)
        return np.asarray(np.polynomial.polynomial.polyval(turn, self.coefficients).real)


@runtime_checkable
class PeriodicFringe(Protocol):
    """A periodic fringe f(u) that knows its Fourier series.

    Its harmonics are sums of Bessel functions.
    """

    def __call__(self, u: ArrayLike) -> Array:
        """Return f(u) [V] at displacements u [m]."""
        ...

    @property
    def fourier(self) -> FourierSeries:
        """Fourier series of f in u."""
        ...


@dataclass(frozen=True)
class HarmonicMap(Tabulated):
    """Amplitudes of the harmonics of the drive over the membrane, at one wavelength.

    x (n_x,), y (n_y,) [m] from the centre of the membrane; harmonic (n_harmonics,) integers n;
    values (n_harmonics, n_y, n_x) complex V_n [V], NaN where not measured; wavelength [m];
    noise_sd [V]: standard deviation of the noise of real and of imaginary part, None where it is
    not known.
    """

    x: Array
    y: Array
    harmonic: NDArray[np.int64]
    values: ComplexArray
    wavelength: float
    noise_sd: float | None = None

    def __post_init__(self) -> None:
        freeze(self)

    def __repr__(self) -> str:
        """Harmonics, points and wavelength."""
        names = ", ".join(f"{n}f" for n in self.harmonic)
        return (
            f"<HarmonicMap of {names}: {len(self.y)} × {len(self.x)} points at "
            f"{self.wavelength * 1e9:.5g} nm>"
        )

    def plot(self) -> "Figure":
        """Draw a panel for each harmonic, in the quadrature that holds the signal."""
        # By name, as `to_dataset`: this floor imports none of a higher one
        figure: Figure = function("femnl.plot.maps:harmonic_map_figure")(self.to_dataset())
        return figure

    def to_dataset(self) -> "xr.Dataset":
        """Return the measurement of kind `map` that these are; `femnl.measurement` writes it.

        Returns: Dataset of real and imag [V] (harmonic, y, x), SI units as attributes.
        """
        found: xr.Dataset = function("femnl.io.measurement:harmonic_map")(
            self.x,
            self.y,
            self.harmonic,
            self.values,
            noise_sd=self.noise_sd,
            wavelength=self.wavelength,
        )
        return found

    def _tables(self) -> list[Table]:
        rows = [self._row(index) for index in range(len(self.harmonic))]
        names = ("harmonic", "largest |V| (V)", "at x (µm)", "at y (µm)", "points")
        columns = dict(zip(names, zip(*rows, strict=True), strict=True))
        title = f"Harmonic maps of {len(self.y)} × {len(self.x)} points"
        title += f" at {self.wavelength * 1e9:.5g} nm"
        note = "noise is not known" if self.noise_sd is None else "±: noise of each quadrature"
        return [Table(title, columns, [note])]

    def _row(self, index: int) -> list[str]:
        """Return where a harmonic is the largest, and how many of its points were measured."""
        size = np.abs(self.values[index])
        name = f"{self.harmonic[index]}f"
        measured = np.count_nonzero(np.isfinite(size))
        if not measured:
            return [name, "–", "–", "–", "0"]
        row, column = np.unravel_index(np.nanargmax(size), size.shape)
        largest = with_error(size[row, column], self.noise_sd)
        place = [micrometres(self.x[column]), micrometres(self.y[row])]
        return [name, largest, *place, str(measured)]


@dataclass(frozen=True)
class HarmonicSpectrum:
    """Harmonics of the drive in recorded traces, one column a step of the drive.

    drive_frequency (n_steps,) [Hz]; harmonic (n_harmonics,) from 0; values (n_harmonics, n_steps)
    complex V_n [V]; values_sd (n_harmonics, n_steps) [V]: standard deviation of real and of
    imaginary part; noise_sd (n_steps,) [V] per sample. correlation_length: how many neighbouring
    samples count as one for a mean, 1 where the noise is white. independent: part of them that
    count as independent for its variance.
    """

    drive_frequency: Array
    harmonic: NDArray[np.int64]
    values: ComplexArray
    values_sd: Array
    noise_sd: Array
    correlation_length: float = 1.0
    independent: float = 1.0

    def __post_init__(self) -> None:
        freeze(self)
