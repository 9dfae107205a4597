"""The Duffing response as an implicit equation of the data.

No roots, no branches, no folds to get stuck at.

With z = V / (drive y_max e^{iφ − 2πi(f − f₀)τ}) the model says z D(|z|²) − 1 = 0, D = δ + a |z|² +
i (1 + d |z|²). To first order in the noise this is as good as the explicit model; to second order
it is biased, so it is where an explicit fit starts.
"""

import numpy as np

from femnl.observe.response.branches import STIFFEN, background_columns
from femnl.observe.response.sweeps import Array, Complex, Sweeps
from femnl.observe.response.theta import Layout

ROUNDS = 12
# Relative change of θ, in standard deviations, at which the start is good enough.
CLOSE = 0.1
LARGEST = 0.7
# Near a fold noise is not amplified by more than 1/FOLD.
FOLD = 0.1


def refine(
    sweeps: Sweeps, layout: Layout, theta: Array, free: np.ndarray[tuple[int], np.dtype[np.bool_]]
) -> Array:
    """Improve what is free of θ by Gauss–Newton steps on the implicit equation.

    Each point is weighted by its noise as it enters the equation.
    """
    for _ in range(ROUNDS):
        residual, slopes = _whitened(sweeps, layout, theta)
        # Data without a resonance lead nowhere; the explicit fit says so
        if not np.all(np.isfinite(slopes)):
            break
        scale = np.linalg.norm(slopes, axis=0) + np.finfo(float).tiny
        part, *_ = np.linalg.lstsq((slopes / scale)[:, free], residual, rcond=1e-10)
        step = np.zeros(len(theta))
        step[free] = part / scale[free]
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
    """Return the equation's residuals (2n,) in σ, and their derivatives by θ.

    The equation is z D − 1 = 0 for z = (V − background)/(drive y_max e^{iφ}) with the delay turned
    back, where D = Δ + i g + (a + i g d)|z|², Δ = (f₀² − f²)/(f₀ w) and g = f/f₀.
    """
    f0, w, ratio, damping, gain, phase, tau = layout.split(theta)
    f = sweeps.frequency
    away = f - f0
    back = np.exp(2j * np.pi * away * tau)
    columns = background_columns(sweeps, layout, f0)
    behind = np.sum(columns * layout.terms(theta)[sweeps.position], axis=1)
    size = gain[sweeps.position] * sweeps.drive
    scale = size * np.exp(1j * phase[sweeps.position])
    moved = sweeps.voltage * back - behind if layout.delayed else (sweeps.voltage - behind) * back
    z = moved / scale
    g = f / f0
    delta = (f0 - f) * (f0 + f) / (f0 * w)
    power = sweeps.drive**2
    x = np.abs(z) ** 2
    bend = STIFFEN * ratio * power + 1j * g * damping * power
    inverse = delta + 1j * g + bend * x

    # What the equation says directly of its coefficients
    by_theta = np.zeros((len(z), layout.size), dtype=complex)
    by_g = 1j * (1 + damping * power * x)
    by_theta[:, 0] = z * layout.width * ((1 + g**2) / w - by_g * g / f0)
    by_theta[:, 1] = -z * delta
    by_theta[:, 2] = z * x * STIFFEN * power
    if layout.damping:
        by_theta[:, 3] = 1j * g * z * x * power
    moves = _motion_slopes(sweeps, layout, theta, z, back=back, scale=scale)
    change = inverse[:, None] * moves
    change += (2 * z * bend)[:, None] * (z.conj()[:, None] * moves).real
    turn = np.where(x > 0, z, 1) / np.where(x > 0, np.abs(z), 1)
    equation = np.column_stack([z * inverse - 1, by_theta + change])
    equation = equation * (turn.conj() * size / sweeps.noise)[:, None]
    rows = whiten(equation, inverse, inverse + 2 * x * bend)
    return rows[:, 0], rows[:, 1:]


def whiten(columns: Complex, across: Complex, along: Complex) -> Array:
    """Undo what the equation does to noise.

    A part along z enters by `along`, a part across it by i · `across`.

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


def _motion_slopes(
    sweeps: Sweeps, layout: Layout, theta: Array, z: Complex, *, back: Complex, scale: Complex
) -> Complex:
    """Return dz/dθ (n, size): how gain, phase, delay and background move what is read as motion."""
    f0, *_, tau = layout.split(theta)
    away = sweeps.frequency - f0
    points = np.arange(len(z))
    out = np.zeros((len(z), layout.size), dtype=complex)
    out[points, layout.gains.start + sweeps.position] = -z
    out[points, layout.phases.start + sweeps.position] = -1j * z
    columns = background_columns(sweeps, layout, f0)
    terms = layout.terms(theta)[sweeps.position]
    factor = 1 / scale if layout.delayed else back / scale
    turned = z + np.sum(columns * terms, axis=1) * factor if layout.delayed else z
    out[:, 0] = -2j * np.pi * tau * layout.width * turned
    out[:, layout.delay] = 2j * np.pi * away / layout.span * turned
    start = layout.backgrounds.start + 2 * layout.background * sweeps.position
    for k in range(layout.background):
        out[points, start + 2 * k] = -columns[:, k] * factor
        out[points, start + 2 * k + 1] = -1j * columns[:, k] * factor
    if layout.background > 1:
        out[:, 0] += terms[:, 1] * columns[:, 0] * factor * layout.width / layout.span
    return out
