"""Gas that a film moves on one side: incompressible flow into the half-space over a baffle."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc

Array = NDArray[np.float64]


def airload(shapes: Array, steps: tuple[float, float]) -> Array:
    """Return ∫∫ ξᵢ(r) ξⱼ(r′)/(2π|r − r′|) dA dA′ of shapes on an even grid, (n, n) [m³].

    This times the density of the gas is the mass that each pair of modes moves: the potential of
    the flow over a rigid plane is φ = −∫ẇ dA′/(2πr).

    Args: shapes (n, n_y, n_x): ξ at the middles of even cells, 0 where the plane is at rest;
        steps: width and height of a cell [m].
    Returns: symmetric and positive. The sum has an error of third order in the step: 2e-5 of the
        mode (1,1) and 3e-4 of (3,3) at 96 cells a side, held by tests/physics/test_gas.py.
    Source: Rayleigh, Theory of Sound (1896), section 278.
    """
    n, n_y, n_x = shapes.shape
    x = steps[0] * np.minimum(np.arange(2 * n_x), 2 * n_x - np.arange(2 * n_x))
    y = steps[1] * np.minimum(np.arange(2 * n_y), 2 * n_y - np.arange(2 * n_y))
    distance = np.hypot(*np.meshgrid(x, y))
    distance[0, 0] = np.inf
    kernel = 1 / distance
    kernel[0, 0] = _own_cell(*steps)
    size = 2 * n_y, 2 * n_x
    wave = np.fft.rfft2(kernel)
    flow = np.fft.irfft2(np.fft.rfft2(shapes, size) * wave, size)[:, :n_y, :n_x]
    area = steps[0] * steps[1]
    found = shapes.reshape(n, -1) @ flow.reshape(n, -1).T * area**2 / (2 * np.pi)
    return np.asarray((found + found.T) / 2)


def _own_cell(a: float, b: float) -> float:
    """Return what stands for 1/r in the cell of the singularity [1/m].

    Such that Σ f/r over a lattice of cells a by b is ∫f/r up to the third order: minus the lattice
    sum of 1/r, by Ewald's method.
    """
    split = np.sqrt(np.pi / (a * b))
    m, n = np.meshgrid(np.arange(-6, 7), np.arange(-6, 7))
    away = (m != 0) | (n != 0)
    r = np.hypot(a * m, b * n)[away]
    q = 2 * np.pi * np.hypot(m / a, n / b)[away]
    near = np.sum(erfc(split * r) / r)
    far = np.sum(2 * np.pi / (a * b) * erfc(q / (2 * split)) / q)
    # The wave q = 0 is the integral itself but for its part within the split.
    return float(-(near + far - 2 * split / np.sqrt(np.pi) - 2 * np.sqrt(np.pi) / (a * b * split)))
