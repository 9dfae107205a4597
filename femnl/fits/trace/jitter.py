"""The jitter of a trigger: what it does to averages of traces, and averages without it."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar

from femnl.core.errors import ParameterError
from femnl.core.fit import Fit, Parameter
from femnl.core.readout import Array, ComplexArray, HarmonicSpectrum


def jitter_gain(harmonic: ArrayLike, frequency: float, jitter: float) -> Array:
    """Return the factor by which trigger jitter weakens harmonic n in an average.

    It is e^{−(nωs)²/2} for delays of standard deviation s [s].
    """
    return np.asarray(np.exp(-((2 * np.pi * frequency * jitter * np.asarray(harmonic)) ** 2) / 2))


def align(shots: HarmonicSpectrum) -> tuple[HarmonicSpectrum, Fit]:
    """Average repeated records after undoing the delay of each, and measure the trigger's jitter.

    V_n of record j is M_n e^{−inωδ_j}: M and δ are found in turn, all harmonics together. A plain
    mean of the records would give M_n e^{−(nωs)²/2}; the mean of the aligned ones gives M_n.

    Args:
        shots: harmonics of records taken at one and the same drive frequency.

    Returns:
        The aligned average as a spectrum of one step, and a fit with the parameter `jitter` s [s]:
        the spread of the delays less what noise contributes to it.

    Raises:
        ParameterError: fewer than two records, or records at different frequencies.

    Valid: delays within half a period of each other; noise well below the first harmonic of a
    single record.
    """
    n_shots = shots.values.shape[1]
    frequency = float(shots.drive_frequency[0])
    if n_shots < 2 or np.ptp(shots.drive_frequency) > 1e-9 * frequency:
        raise ParameterError(
            f"align needs two or more records at one drive frequency, not {n_shots} at "
            f"{np.unique(shots.drive_frequency).size}"
        )
    rate = np.asarray(2 * np.pi * frequency * shots.harmonic, np.float64)
    weight = 1 / np.mean(shots.values_sd**2, axis=1)
    model = shots.values[:, 0]
    delay = np.zeros(n_shots)
    for _ in range(20):
        before = delay
        delay = np.array([_delay(model, values, weight, rate) for values in shots.values.T])
        delay -= delay.mean()
        model = np.mean(shots.values * np.exp(1j * np.outer(rate, delay)), axis=1)
        if np.abs(delay - before).max() < 1e-9 / frequency:
            break
    blur = 1 / np.sum(weight * rate**2 * np.abs(model) ** 2)
    spread = float(np.var(delay, ddof=1))
    square = spread - blur
    square_sd = spread * np.sqrt(2 / (n_shots - 1))
    jitter = float(np.sqrt(max(square, 0)))
    sd = (
        float(square_sd / (2 * jitter))
        if square > square_sd
        else float(np.sqrt(max(square, 0) + square_sd))
    )
    notes = (
        ()
        if square > 2 * square_sd
        else (
            "the delays scatter no more than noise explains: read the standard deviation as an "
            "upper limit",
        )
    )
    residual = (shots.values * np.exp(1j * np.outer(rate, delay)) - model[:, None]) * np.sqrt(
        weight
    )[:, None]
    n_points = 2 * shots.values.size - n_shots
    n_parameters = n_shots - 1 + 2 * len(model) - 1
    chi2 = float(np.sum(np.abs(residual) ** 2) / (n_points - n_parameters))
    average = HarmonicSpectrum(
        shots.drive_frequency[:1],
        shots.harmonic,
        model[:, None],
        np.sqrt(np.mean(shots.values_sd**2, axis=1, keepdims=True) / n_shots),
        np.array([np.sqrt(np.mean(shots.noise_sd**2) / n_shots)]),
    )
    return average, Fit(
        {"jitter": Parameter("jitter", jitter, sd, "s")},
        np.array([[sd**2]]),
        chi2,
        n_points,
        n_parameters,
        notes,
    )


def _delay(model: ComplexArray, values: ComplexArray, weight: Array, rate: Array) -> float:
    """Return the delay δ [s] that makes values closest to model·e^{−inωδ}.

    The best of a grid over one period, then refined.
    """
    overlap = weight * np.conj(model) * values
    period = 2 * np.pi / rate[1]
    grid = period * (np.arange(16 * len(rate)) / (16 * len(rate)) - 0.5)
    best = grid[np.argmax((np.exp(1j * np.outer(grid, rate)) @ overlap).real)]
    width = period / (16 * len(rate))
    found = minimize_scalar(
        lambda delay: -float((np.exp(1j * rate * delay) @ overlap).real),
        bounds=(best - width, best + width),
        method="bounded",
        options={"xatol": 1e-12 * period},
    )
    return float(found.x)
