"""The Duffing response as an implicit equation of the data.

No roots, no branches, no folds to get stuck at.

With z = V / (drive y_max e^{iφ − 2πi(f − f₀)τ}) the model says z D(|z|²) − 1 = 0, D = δ + a |z|² +
i (1 + d |z|²). To first order in the noise this is as good as the explicit model; to second order
it is biased, so it is where an explicit fit starts.
"""

import numpy as np

from femnl.observe.response.branches import STIFFEN, Layout
from femnl.observe.response.sweeps import Array, Complex, Sweeps

ROUNDS = 12
# Relative change of θ, in standard deviations, at which the start is good enough.
CLOSE = 0.1
LARGEST = 0.7
# Near a fold noise is not amplified by more than 1/FOLD.
FOLD = 0.1


def refine(sweeps: Sweeps, layout: Layout, theta: Array) -> Array:
    """Improve θ by Gauss–Newton steps on the implicit equation.

    Each point is weighted by its noise as it enters the equation.
    """
    for _ in range(ROUNDS):
        residual, slopes = _whitened(sweeps, layout, theta)
        # Data without a resonance lead nowhere; the explicit fit says so
        if not np.all(np.isfinite(slopes)):
            break
        scale = np.linalg.norm(slopes, axis=0) + np.finfo(float).tiny
        step, *_ = np.linalg.lstsq(slopes / scale, residual, rcond=1e-10)
        step = step / scale
        # ln w and ln y_max may change by a factor of two at a time, the rest along with them.
        step *= min(
            1.0,
            LARGEST
            / max(
                abs(step[1]), np.max(np.abs(step[layout.gains]), initial=0.0), np.finfo(float).tiny
            ),
        )
        theta = theta - step
        if layout.damping:
            theta[3] = max(theta[3], 0.0)
        if np.max(np.abs(step) * scale) < CLOSE:
            break
    return theta


def _whitened(sweeps: Sweeps, layout: Layout, theta: Array) -> tuple[Array, Array]:
    """Return the equation's residuals (2n,) in σ, and their derivatives by θ."""
    f0, w, ratio, damping, gain, phase, tau = layout.split(theta)
    away = sweeps.frequency - f0
    scale = gain[sweeps.position] * sweeps.drive
    z = sweeps.voltage / scale * np.exp(-1j * (phase[sweeps.position] - 2 * np.pi * away * tau))
    power = sweeps.drive**2
    x = np.abs(z) ** 2
    slope = STIFFEN * ratio * power + 1j * damping * power
    inverse = -2 * away / w + 1j + slope * x
    turn = z / np.abs(z)
    delta = -2 * away / w
    by_theta = _slopes(
        sweeps, layout, z, inverse=inverse, slope=slope, delta=delta, w=w, tau=tau, away=away
    )
    equation = (
        np.column_stack([z * inverse - 1, by_theta]) * (turn.conj() * scale / sweeps.noise)[:, None]
    )
    rows = whiten(equation, inverse, inverse + 2 * x * slope)
    return rows[:, 0], rows[:, 1:]


def whiten(columns: Complex, across: Complex, along: Complex) -> Array:
    """Undo what the equation does to noise.

    a part along z enters by `along`, a part across it by i · `couples_blocks`.

    columns (…, n, k), turned so that z is real and positive; across and along (…, n). Return (…,
    2n, k) real; at a fold, where the map cannot be inverted, the weight falls to zero.
    """
    determinant = (along * across.conj()).real
    weight = determinant / (determinant**2 + (FOLD * np.abs(across) ** 2) ** 2)
    p = (across * weight)[..., None]
    q = (along * weight)[..., None]
    first = p.real * columns.real + p.imag * columns.imag
    second = q.real * columns.imag - q.imag * columns.real
    return np.concatenate([first, second], axis=-2)


def _slopes(
    sweeps: Sweeps,
    layout: Layout,
    z: Complex,
    *,
    inverse: Complex,
    slope: Complex,
    delta: Array,
    w: float,
    tau: float,
    away: Array,
) -> Complex:
    """Return the derivatives (n, size) of z D by θ."""
    n = len(z)
    power = sweeps.drive**2
    x = np.abs(z) ** 2
    out = np.zeros((n, layout.size), dtype=complex)
    out[:, 0] = z * layout.width * (2 / w - 2j * np.pi * tau * inverse)
    out[:, 1] = -z * delta
    out[:, 2] = z * x * STIFFEN * power
    if layout.damping:
        out[:, 3] = 1j * z * x * power
    points = np.arange(n)
    out[points, layout.gains.start + sweeps.position] = -z * (inverse + 2 * x * slope)
    out[points, layout.phases.start + sweeps.position] = -1j * z * inverse
    out[:, -1] = 2j * np.pi * away / layout.span * z * inverse
    return out
