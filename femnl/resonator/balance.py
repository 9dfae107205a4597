"""Harmonic balance with any number of harmonics.

Periodic motions of the full equations and their Floquet stability.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, expm

from femnl.core.errors import ConvergenceError
from femnl.core.resonator import Array, Complex, CoupledModes
from femnl.resonator.system import nonlinear_force, nonlinear_slopes, scaled

# Enough samples for a product of five harmonics to be free of aliasing in the harmonics kept.
DEGREE = 5
MAX_STEPS = 30
TOLERANCE = 1e-12
MIN_FLOQUET_STEPS = 256


@dataclass(frozen=True)
class Balance:
    """The algebraic equations for the Fourier coefficients of a periodic motion.

    In dimensionless form.

    The unknowns are, mode by mode, the constant and then Re and Im of each harmonic, q = a₀ + Σ
    Re(a_h e^{ihτ}), τ = ωt; time is in units of 1/ω₁ and displacement in `length` [m].
    """

    modes: CoupledModes
    force: Array
    length: float
    rate: float
    n_harmonics: int
    basis: Array
    derivative: Array
    project: Array

    @classmethod
    def of(cls, modes: CoupledModes, force: Array, n_harmonics: int) -> "Balance":
        """Set up the balance for forces 𝓕ᵢ [m/s²] with harmonics 0 … n_harmonics."""
        rate = float(modes.omega[np.argmax(np.abs(force))])
        length = float(np.max(np.abs(force) / (modes.omega * modes.damping)))
        order = np.arange(1, n_harmonics + 1)
        phase = np.arange((DEGREE + 1) * n_harmonics + 2) * (
            2 * np.pi / ((DEGREE + 1) * n_harmonics + 2)
        )
        waves = np.stack([np.cos(np.outer(phase, order)), -np.sin(np.outer(phase, order))], axis=-1)
        basis = np.hstack([np.ones((len(phase), 1)), waves.reshape(len(phase), -1)])
        derivative = block_diag(np.zeros((1, 1)), *(np.array([[0.0, -h], [h, 0.0]]) for h in order))
        project = (basis / np.sum(basis**2, axis=0)).T
        return cls(
            scaled(modes, length, rate),
            force / (length * rate**2),
            length,
            rate,
            n_harmonics,
            basis,
            derivative,
            project,
        )

    @property
    def size(self) -> int:
        """Unknowns per mode."""
        return 2 * self.n_harmonics + 1

    def pack(self, coefficients: Complex) -> Array:
        """Turn complex coefficients (modes, H' + 1) [m] into unknowns; missing ones are zero."""
        x = np.zeros((self.modes.count, self.size))
        kept = min(coefficients.shape[1] - 1, self.n_harmonics)
        x[:, 0] = coefficients[:, 0].real
        x[:, 1 : 2 * kept + 1 : 2] = coefficients[:, 1 : kept + 1].real
        x[:, 2 : 2 * kept + 2 : 2] = coefficients[:, 1 : kept + 1].imag
        return np.asarray(x.ravel() / self.length)

    def unpack(self, x: Array) -> Complex:
        """Turn unknowns into complex coefficients (modes, H + 1) [m]."""
        rows = x.reshape(self.modes.count, self.size) * self.length
        return np.asarray(np.hstack([rows[:, :1], rows[:, 1::2] + 1j * rows[:, 2::2]]))

    def residual(self, x: Array, omega: float) -> tuple[Array, Array, Array]:
        """Return the residual and its derivatives by unknowns and by the drive frequency.

        The frequency is dimensionless.
        """
        modes = self.modes
        n = self.modes.count
        size = self.size
        rows = x.reshape(n, size)
        turned = rows @ self.derivative.T
        q = rows @ self.basis.T
        slope = turned @ self.basis.T
        second = turned @ self.derivative.T
        by_q, by_v = nonlinear_slopes(modes, q, omega * slope)
        value = (
            omega**2 * second
            + modes.omega[:, None] ** 2 * rows
            + omega * modes.damping[:, None] * turned
        )
        value += nonlinear_force(modes, q, omega * slope) @ self.project.T
        value[:, 1] -= self.force
        by_omega = (
            2 * omega * second + modes.damping[:, None] * turned + (by_v * slope) @ self.project.T
        )
        jacobian = np.einsum("st,ijt,tr->isjr", self.project, by_q, self.basis, optimize=True)
        speed = self.basis @ self.derivative
        for i in range(n):
            jacobian[i, :, i] += omega**2 * self.derivative @ self.derivative + modes.omega[
                i
            ] ** 2 * np.eye(size)
            jacobian[i, :, i] += omega * (
                modes.damping[i] * self.derivative + (self.project * by_v[i]) @ speed
            )
        return value.ravel(), jacobian.reshape(n * size, n * size), by_omega.ravel()

    def solve(self, x: Array, omega: float) -> Array:
        """Solve for the motion at the drive frequency ω/ω₁ by Newton's method from the start x."""
        for _ in range(MAX_STEPS):
            value, jacobian, _ = self.residual(x, omega)
            step = np.linalg.solve(jacobian, value)
            x = x - step
            if np.linalg.norm(step) <= TOLERANCE * np.linalg.norm(x):
                return x
        raise ConvergenceError(
            f"n_harmonics = {self.n_harmonics}: no periodic motion found near the start at "
            f"{omega * self.rate / (2 * np.pi):.9g} Hz; start closer, or keep more harmonics"
        )

    def multipliers(self, x: Array, omega: float) -> Complex:
        """Return the Floquet multipliers (2n,) over one drive period.

        By the fourth-order Magnus expansion (Blanes et al. 2009).
        """
        modes = self.modes
        n = self.modes.count
        count = max(MIN_FLOQUET_STEPS, 24 * self.n_harmonics)
        nodes = (np.arange(count)[:, None] + 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3)).ravel() * (
            2 * np.pi / count
        )
        order = np.arange(self.n_harmonics + 1)
        spin = np.exp(1j * np.outer(order, nodes))
        coefficients = self.unpack(x) / self.length
        q = (coefficients @ spin).real
        v = (coefficients * 1j * order * omega @ spin).real
        by_q, by_v = nonlinear_slopes(modes, q, v)
        a = np.zeros((len(nodes), 2 * n, 2 * n))
        a[:, :n, n:] = np.eye(n)
        a[:, n:, :n] = -np.moveaxis(by_q, 2, 0) - np.diag(modes.omega**2)
        a[:, n + np.arange(n), n + np.arange(n)] = -(by_v + modes.damping[:, None]).T
        first = a[::2]
        last = a[1::2]
        step = 2 * np.pi / (count * omega)
        exponent = step / 2 * (first + last) - np.sqrt(3) / 12 * step**2 * (
            first @ last - last @ first
        )
        product = np.eye(2 * n)
        for factor in expm(exponent):
            product = factor @ product
        return np.asarray(np.linalg.eigvals(product).astype(complex))
