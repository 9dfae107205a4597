"""Resonance lines on a smooth background: their model, and the joint fit of lines that overlap."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from femnl.fits.covariance import covariance

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

REACH = 12.0  # linewidths on either side of a line that its fit looks at
_DEGREE = 2  # of the complex polynomial that stands for the background in a window


def line(f: Array, frequency: float, linewidth: float) -> Complex:
    """Return the response of a driven resonator of unit height.

    F_kγ/(f_k² − f² + i f γ), which is −i on resonance.
    """
    return np.asarray(frequency * linewidth / (frequency**2 - f**2 + 1j * f * linewidth))


@dataclass(frozen=True, eq=False)
class Cluster:
    """Lines fitted together: frequency, linewidth [Hz], their sd; amplitude [V] with its sd.

    Background polynomial; χ² and points.
    """

    frequency: Array
    linewidth: Array
    frequency_sd: Array
    linewidth_sd: Array
    amplitude: Complex
    amplitude_sd: Array
    background: Complex
    window: tuple[float, float]
    chi2: float
    n_points: int

    def lines(self, f: Array) -> Complex:
        """Sum of the lines at the frequencies f [Hz], in V."""
        total = np.zeros(f.shape, dtype=complex)
        for frequency, linewidth, amplitude in zip(
            self.frequency, self.linewidth, self.amplitude, strict=True
        ):
            total += amplitude * line(f, frequency, linewidth)
        return total


def polynomials(f: Array, window: tuple[float, float]) -> Array:
    """Legendre polynomials up to the background's degree on the window, (n_points, degree + 1)."""
    low, high = window
    return np.asarray(
        np.polynomial.legendre.legvander(2 * (f - low) / (high - low) - 1, _DEGREE), dtype=float
    )


def derivatives(f: Array, frequency: float, linewidth: float) -> tuple[Complex, Complex]:
    """Return the derivatives of the line by frequency and by linewidth."""
    under = frequency**2 - f**2 + 1j * f * linewidth
    by_frequency = linewidth / under - 2 * frequency**2 * linewidth / under**2
    by_linewidth = frequency / under - 1j * f * frequency * linewidth / under**2
    return np.asarray(by_frequency), np.asarray(by_linewidth)


def _stack(values: Complex) -> Array:
    return np.concatenate([values.real, values.imag])


class _Problem:
    """Variable projection.

    Frequencies and widths are searched; amplitudes and background follow by linear least
    squares.

    Unknowns are the shift of each line in units of its starting width, and the logarithm of the
    ratio of widths.
    Source: L. Kaufman, BIT 15, 49 (1975), for the Jacobian.
    """

    def __init__(
        self, f: Array, volts: Complex, noise: float, start: Array, window: tuple[float, float]
    ) -> None:
        self.f = f
        self.volts = volts
        self.noise = noise
        self.start = start
        self.basis = polynomials(f, window).astype(complex)
        self.last: tuple[bytes, tuple[Complex, Complex, Complex]] | None = None

    def parameters(self, unknowns: Array) -> Array:
        """Return (n_lines, 2): frequency and linewidth [Hz]."""
        shift, growth = unknowns.reshape(2, -1)
        return np.column_stack(
            [self.start[:, 0] + shift * self.start[:, 1], self.start[:, 1] * np.exp(growth)]
        )

    def solve(self, unknowns: Array) -> tuple[Complex, Complex, Complex]:
        """Return orthonormal basis of the linear part, its coefficients, and the residual [V]."""
        # The search asks for residual and Jacobian at the same place, one after the other.
        if self.last is not None and self.last[0] == unknowns.tobytes():
            return self.last[1]
        columns = [line(self.f, frequency, width) for frequency, width in self.parameters(unknowns)]
        orthonormal, triangle = np.linalg.qr(np.column_stack([*columns, self.basis]))
        inside = orthonormal.conj().T @ self.volts
        coefficients = np.asarray(np.linalg.lstsq(triangle, inside, rcond=1e-13)[0], dtype=complex)
        self.last = (
            unknowns.tobytes(),
            (orthonormal, coefficients, np.asarray(self.volts - orthonormal @ inside)),
        )
        return self.last[1]

    def residual(self, unknowns: Array) -> Array:
        """Return real residuals in standard deviations."""
        return _stack(self.solve(unknowns)[2]) / self.noise

    def jacobian(self, unknowns: Array) -> Array:
        """Return Kaufman's Jacobian of `residual`."""
        orthonormal, coefficients, _ = self.solve(unknowns)
        shifts = []
        growths = []
        for (frequency, width), (_, scale), amplitude in zip(
            self.parameters(unknowns), self.start, coefficients, strict=False
        ):
            by_frequency, by_width = derivatives(self.f, frequency, width)
            shifts.append(-amplitude * scale * by_frequency)
            growths.append(-amplitude * width * by_width)
        columns = np.column_stack(shifts + growths)
        columns = columns - orthonormal @ (orthonormal.conj().T @ columns)
        return np.vstack([columns.real, columns.imag]) / self.noise


def _bounds(
    start: Array, window: tuple[float, float], widths: tuple[float, float]
) -> tuple[Array, Array]:
    """Return the least and the largest of the unknowns of a `_Problem`.

    A line may leave its start by a few linewidths, or a few of the smallest one, but not leave the
    window.

    Args: as of `fit_cluster`.
    """
    slack = np.maximum(3.0, 2 * widths[0] / start[:, 1])
    low_growth, high_growth = np.log(np.array(widths)[:, None] / start[:, 1])
    low_shift, high_shift = (np.array(window)[:, None] - start[:, 0]) / start[:, 1]
    low = np.concatenate([np.maximum(-slack, low_shift - 1e-9), low_growth])
    high = np.concatenate([np.minimum(slack, high_shift + 1e-9), high_growth])
    return low, high


def _relative_sd(problem: _Problem, parameters: Array, amplitude: Complex, largest: float) -> Array:
    """Return the standard deviations (n_lines, 4) of frequency, linewidth and amplitude of lines.

    They are over the linewidth and the modulus of the amplitude, whose real and imaginary parts
    have one each.

    Args: largest: modulus of the data [V].
    """
    columns: list[Complex] = []
    for (frequency, width), height in zip(parameters, amplitude, strict=True):
        by_frequency, by_width = derivatives(problem.f, frequency, width)
        shape = line(problem.f, frequency, width)
        # In units of the width and of the height, so that the matrix is well scaled.
        columns += [
            height * width * by_frequency,
            height * width * by_width,
            abs(height) * shape,
            1j * abs(height) * shape,
        ]
    for column in problem.basis.T:
        columns += [largest * column, 1j * largest * column]
    jacobian = np.column_stack([_stack(column) for column in columns]) / problem.noise
    names = [str(column) for column in range(jacobian.shape[1])]
    variance = np.diag(covariance(jacobian, names, np.ones(len(names)))[0])
    return np.asarray(np.sqrt(variance[: 4 * len(parameters)].reshape(-1, 4)))


def fit_cluster(
    f: Array,
    volts: Complex,
    noise: float,
    start: Array,
    window: tuple[float, float],
    widths: tuple[float, float],
) -> Cluster:
    """Fit lines and a quadratic complex background to the points of a window.

    Args: f [Hz] and volts [V] of all points of the window, other lines taken off; noise [V] per
    quadrature; start (n_lines, 2): frequency and linewidth [Hz]; widths [Hz]: the
    smallest linewidth that the spacing of points can tell from none, and the largest that the
    background cannot be.
    Returns: the Cluster at the least-squares optimum with standard deviations from the full
    Jacobian.
    """
    start = np.column_stack(
        [np.clip(start[:, 0], *window), np.clip(start[:, 1], 1.01 * widths[0], 0.99 * widths[1])]
    )
    problem = _Problem(f, volts, noise, start, window)
    count = start.shape[0]
    found = least_squares(
        problem.residual,
        np.zeros(2 * count),
        problem.jacobian,
        bounds=_bounds(start, window, widths),
        xtol=1e-7,
        ftol=1e-9,
        max_nfev=60,
    )
    parameters = problem.parameters(found.x)
    _, coefficients, residual = problem.solve(found.x)
    amplitude = coefficients[:count]
    sd = _relative_sd(problem, parameters, amplitude, float(abs(volts).max()))
    return Cluster(
        frequency=parameters[:, 0],
        linewidth=parameters[:, 1],
        frequency_sd=sd[:, 0] * parameters[:, 1],
        linewidth_sd=sd[:, 1] * parameters[:, 1],
        amplitude=amplitude,
        amplitude_sd=np.max(sd[:, 2:], axis=1) * np.abs(amplitude),
        background=coefficients[count:],
        window=window,
        chi2=float(np.sum(np.abs(residual) ** 2) / noise**2),
        n_points=2 * f.size,
    )
