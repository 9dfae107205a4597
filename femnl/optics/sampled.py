"""Harmonics of a fringe at many points at once.

Each point has its own amplitude and its own phase of the fringe.
"""

import numpy as np
from numpy.typing import NDArray

from femnl.core.compiled import compiled
from femnl.core.memo import recent
from femnl.core.readout import Array, ComplexArray
from femnl.core.stages import Fringe, Motion, Wave
from femnl.optics.bessel_table import NODES, bessel_table

Orders = NDArray[np.int64]

PIECE = 4096
SAMPLES = 8
"""Points whose harmonics are summed at a time, and samples of each; fewer points where there are
more samples.
"""
FAINT = 1e-6
"""Overtones of the fringe below this part of the first change no map that can be measured."""
PHASES = 4096
"""Phases at which a fringe is tabulated: its largest value is good to 3e-7 of a cosine, between
them it errs by (2πk/4096)⁴/384.
"""


def harmonics(motion: Motion, fringe: Fringe, harmonic: Orders) -> ComplexArray:
    """Return V_n/V_C at every point, (n_harmonics, n_points), v(t) = Σ_n Re(V_n e^{inωt}).

    A sinusoidal motion under a fringe without limits is summed over Bessel functions, any other
    sampled over a period.
    """
    waves = (Wave(fringe.coefficients, fringe.wavelength), *fringe.beside)
    rails = np.array([fringe.floor, fringe.limit])
    if len(motion.displacement) == 1 and np.all(np.isinf(rails)):
        return np.asarray(
            sum(
                _bessel_sum(
                    motion.displacement, motion.theta, wave.coefficients, wave.wavelength, harmonic
                )
                for wave in waves
            )
        )
    size = max(len(wave.coefficients) for wave in waves)
    coefficients = np.array(
        [np.pad(wave.coefficients, (0, size - len(wave.coefficients))) for wave in waves]
    )
    return _sampled_sum(
        motion.displacement,
        motion.theta,
        coefficients,
        np.array([wave.wavelength for wave in waves]),
        rails,
        harmonic,
    )


def _kept(coefficients: ComplexArray) -> tuple[ComplexArray, Orders]:
    """Return the series (n_orders,) without faint overtones, and the orders that are left."""
    kept = np.flatnonzero(np.abs(coefficients) > FAINT * np.abs(coefficients[1:]).max())
    orders = kept[kept > 0]
    series = np.zeros(orders.max() + 1, complex)
    series[orders] = coefficients[orders]
    return series, orders


def _bessel(
    displacement: ComplexArray,
    theta: Array,
    coefficients: ComplexArray,
    wavelength: float,
    harmonic: Orders,
) -> ComplexArray:
    series, orders = _kept(coefficients)
    return _by_bessel(displacement[0], theta, series, orders, 4 * np.pi / wavelength, harmonic)


_bessel_sum = recent(_bessel, 36)


@recent
def _sampled_sum(
    displacement: ComplexArray,
    theta: Array,
    coefficients: ComplexArray,
    wavelength: Array,
    rails: Array,
    harmonic: Orders,
) -> ComplexArray:
    """Return harmonics from samples; coefficients (n_waves, n_orders), wavelength (n_waves,)."""
    kept = [_kept(row)[0] for row in coefficients]
    whole, orders = _kept(coefficients.sum(axis=0))
    q = 4 * np.pi / wavelength
    return _by_sampling(
        q[0] * displacement, theta, (whole, kept, q / q[0]), orders, rails, harmonic
    )


def _by_bessel(
    swing: ComplexArray,
    theta: Array,
    series: ComplexArray,
    orders: Orders,
    q: float,
    harmonic: Orders,
) -> ComplexArray:
    """Return 2 Σ_k Re(iⁿ c_k e^{ikθ}) J_n(kqA) e^{inφ}."""
    reach = float(orders.max() * q * np.abs(swing).max())
    table = bessel_table(tuple(harmonic.tolist()), reach)
    amplitude, unit = _polar(swing)
    phase = theta if np.ptp(theta) else theta[:1]
    found = np.empty((len(harmonic), len(swing)), complex)
    compiled(_sum)(
        found,
        NODES * q * amplitude,
        unit,
        (orders, 2 * series[orders], np.exp(1j * np.outer(orders, phase))),
        table,
        harmonic,
    )
    return found


def _sum(
    found: ComplexArray,
    place: Array,
    unit: ComplexArray,
    terms: tuple[Orders, ComplexArray, ComplexArray],
    table: Array,
    harmonic: Orders,
) -> None:
    """Sum the terms lit_k e^{ikθ} of a fringe at each point.

    J_n comes from the table by cubic Hermite interpolation.

    Args: found: V_n, (n_harmonics, n_points), filled in. place (n_points,): argument of the Bessel
        functions of the first order, in nodes. unit (n_points,): e^{iφ}. terms: orders k, lit_k,
        and e^{ikθ} (n_orders, n_points), or (n_orders, 1) where all are alike. table: see
        `bessel_table`.
    """
    orders, lit, turns = terms
    summed = np.empty(len(harmonic))
    quarter = harmonic % 4
    each = int(turns.shape[1] > 1)
    for i in range(len(place)):
        summed[:] = 0.0
        for j in range(len(orders)):
            at = orders[j] * place[i]
            left = int(at)
            s = at - left
            term = lit[j] * turns[j, i * each]
            sides = term.real, -term.imag, -term.real, term.imag  # Re(iⁿ …)
            for h in range(len(harmonic)):
                value = table[left, h, 0] + s * (
                    table[left, h, 1] + s * (table[left, h, 2] + s * table[left, h, 3])
                )
                summed[h] += sides[quarter[h]] * value
        power = 1.0 + 0.0j
        n = 0
        for h in range(len(harmonic)):
            if harmonic[h] < n:  # not in rising order
                power = 1.0 + 0.0j
                n = 0
            for _ in range(harmonic[h] - n):
                power *= unit[i]
            n = harmonic[h]
            found[h, i] = summed[h] * power


def _powers(unit: ComplexArray, harmonic: Orders) -> ComplexArray:
    """Return uⁿ, (n_harmonics, n_points), by products."""
    rows = np.ones((int(harmonic.max()) + 1, len(unit)), complex)
    for n in range(1, len(rows)):
        np.multiply(rows[n - 1], unit, out=rows[n])
    return rows[harmonic]


def _largest(series: ComplexArray) -> float:
    """Return the largest |Re Σ_k c_k e^{ikφ}| over all φ."""
    return float(np.abs(np.fft.irfft(np.append(0, series[1:]), PHASES)).max() * PHASES / 2)


def _by_sampling(
    depth: ComplexArray,
    theta: Array,
    waves: tuple[ComplexArray, list[ComplexArray], Array],
    orders: Orders,
    rails: Array,
    harmonic: Orders,
) -> ComplexArray:
    """Return the harmonics from samples of a period.

    Args: depth: motion times q, by order of the drive, (n_orders, n_points) [rad]. theta: phase of
        the fringe (n_points,) [rad]. waves: coefficients of the whole fringe, of each plane wave,
        and q of each over that of the first; orders: those that are not zero.
        rails: where the detector clips below and above, in units of the fringe's largest value.
        harmonic: orders n.
    Returns: V_n/V_C, (n_harmonics, n_points).
    """
    series, each, turns = waves
    read = np.stack([_pieces(one) for one in each]), turns
    reach = np.sum(np.abs(depth) * np.arange(1, len(depth) + 1)[:, None], axis=0).max()
    # A clipped signal has many harmonics that would be folded back
    sharp = 1 if np.all(np.isinf(rails)) else 4
    n_samples = sharp * (32 + 2 * int(harmonic.max() + orders.max() * reach))
    low, top = rails * _largest(series)
    tau = 2 * np.pi * np.arange(n_samples) / n_samples
    angles = np.outer(harmonic, tau)
    # Counted from its turning point, the signal is even: half a period is enough
    if len(depth) == 1:
        half = slice(n_samples // 2 + 1)
        sums = 4 / n_samples * np.cos(angles[:, half])
        sums[:, [0, -1]] /= 2
        amplitude, unit = _polar(depth[0])
        return _sampled(
            np.cos(tau[half])[:, None], amplitude[None], theta, sums, read, (low, top)
        ) * _powers(unit, harmonic)
    overtones = np.outer(np.arange(1, len(depth) + 1), tau)
    swings = np.hstack([np.cos(overtones).T, -np.sin(overtones).T])
    moves = np.vstack([depth.real, depth.imag])
    sums = 2 / n_samples * np.vstack([np.cos(angles), -np.sin(angles)])
    found = _sampled(swings, moves, theta, sums, read, (low, top))
    return np.asarray(found[: len(harmonic)] + 1j * found[len(harmonic) :])


def _polar(swing: ComplexArray) -> tuple[Array, ComplexArray]:
    """Return |A| and A/|A|, 1 where nothing moves."""
    amplitude = np.abs(swing)
    return amplitude, np.asarray(
        np.where(amplitude > 0, swing, 1) / np.where(amplitude > 0, amplitude, 1), complex
    )


def _sampled(
    swings: Array,
    moves: Array,
    theta: Array,
    sums: Array,
    waves: tuple[Array, Array],
    rails: tuple[float, float],
) -> Array:
    """Return weighted sums (m, n_points) of the samples of a fringe.

    The fringe is read at the phases swings (n_samples, k) times moves (k, n_points) + θ.

    Args: sums (m, n_samples): weights of the samples. waves: the pieces of each wave of the fringe,
    and the factors that turn the phases for them. rails: the lowest and the highest signal, at
    which the fringe is clipped.
    """
    found = np.empty((len(sums), moves.shape[1]))
    read = compiled(_read)
    step = max(1, PIECE * SAMPLES // len(swings))
    room = np.empty(len(swings) * step)
    for start in range(0, moves.shape[1], step):
        here = slice(start, start + step)
        v = room[: len(swings) * len(theta[here])].reshape(len(swings), -1)
        np.matmul(swings, moves[:, here], out=v)
        read(v, theta[here], *waves, *rails)
        found[:, here] = sums @ v
    return found


def _pieces(series: ComplexArray) -> Array:
    """Return the coefficients of cubic pieces of Re Σ_k c_k e^{ikφ} between `PHASES` nodes of φ.

    The nodes span a period, and the lowest power comes first: (n_nodes, 4).
    """
    slopes = 2j * np.pi / PHASES * np.arange(len(series)) * series
    value, slope = (
        np.fft.irfft(np.append(0, part[1:]), PHASES) * PHASES / 2 for part in (series, slopes)
    )
    rise = np.roll(value, -1) - value
    last = np.roll(slope, -1)
    return np.stack([value, slope, 3 * rise - 2 * slope - last, slope + last - 2 * rise], axis=1)


def _read(phase: Array, theta: Array, pieces: Array, turns: Array, low: float, top: float) -> None:
    """Put a fringe, clipped at low and top, in place of its phase, by cubic interpolation.

    Args: phase (n_samples, n_points), without theta (n_points,). pieces (n_waves, n_nodes, 4): of
    each wave of the fringe, which are added up. turns (n_waves,): factors on the phase for them.
    """
    n_nodes = pieces.shape[1]
    per = n_nodes / (2 * np.pi)
    summed = np.empty(len(theta))
    for i in range(len(phase)):
        summed[:] = 0.0
        for w in range(len(turns)):
            for j in range(len(theta)):
                place = (turns[w] * phase[i, j] + theta[j]) * per
                left = np.floor(place)
                s = place - left
                # The number of pieces is a power of two
                k = int(left) & (n_nodes - 1)
                p = pieces[w, k]
                summed[j] += p[0] + s * (p[1] + s * (p[2] + s * p[3]))
        for j in range(len(theta)):
            phase[i, j] = min(max(summed[j], low), top)
