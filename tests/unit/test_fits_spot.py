"""Motion in metres from the traces of a drive sweep, without a ruler."""

import numpy as np
import pytest

import femnl
from femnl.core.errors import ParameterError
from femnl.core.readout import Array, HarmonicSpectrum, PeriodicFringe
from femnl.fits.trace.decompose import decompose
from femnl.fits.trace.spot import fit_spot
from femnl.io.measurement import trace as record
from femnl.optics.fringe import MultilayerFringe, SineFringe
from femnl.optics.harmonics import trace

RED = 632.8e-9
F = 1.466e6
TIME = np.arange(1024) / 125e6
DETUNING = np.linspace(-4, 4, 31)
AMPLITUDE = 4.5e-7 / np.hypot(1, DETUNING)
PHASE = -np.pi / 2 - np.arctan(DETUNING)
"""A resonance driven to z = 8.9."""


def sweep(fringe: PeriodicFringe, noise: float, seed: int) -> HarmonicSpectrum:
    """Harmonics of the traces of a sweep through the resonance."""
    rng = np.random.default_rng(seed)
    frequency = F + 70 * DETUNING
    clean = np.array(
        [trace(fringe, TIME, f, a, p) for f, a, p in zip(frequency, AMPLITUDE, PHASE, strict=True)]
    )
    return decompose(
        record(TIME, clean + noise * rng.normal(size=clean.shape), drive_frequency=frequency),
        n_harmonics=21,
    )


def turned(angle: Array) -> Array:
    return np.asarray(np.pi - (np.pi - angle) % (2 * np.pi))


@pytest.mark.parametrize("seed", range(3))
def test_motion_at_every_step_of_a_sweep_is_found_in_metres(seed: int) -> None:
    found = fit_spot(sweep(SineFringe(RED, 0.1, 0.02, 0.6), 2e-3, seed), RED)
    z = np.concatenate(
        [
            (found.amplitude - AMPLITUDE) / found.amplitude_sd,
            turned(found.phase - PHASE) / found.phase_sd,
        ]
    )
    assert np.abs(z).max() < 4.5
    assert np.mean(np.abs(z) < 1) == pytest.approx(0.68, abs=0.2)
    assert abs(found.fit["fringe_phase"] - 0.6) < 4 * found.fit.parameters["fringe_phase"].sd
    assert abs(found.fit["contrast"] - 0.02) < 4 * found.fit.parameters["contrast"].sd
    assert found.fit.chi2_reduced == pytest.approx(1, abs=0.15)
    assert found.amplitude_sd.max() < 4e-9


def test_motion_under_the_stack_of_the_paper_needs_the_stack() -> None:
    stack = femnl.load("square-270um").stack
    assert stack is not None
    fringe = MultilayerFringe(stack, RED, gain=0.08)
    spectrum = sweep(fringe, 2e-3, 5)
    found = fit_spot(spectrum, RED, fringe)
    assert np.abs((found.amplitude - AMPLITUDE) / found.amplitude_sd).max() < 4.5
    assert found.fit.chi2_reduced == pytest.approx(1, abs=0.15)
    assert fit_spot(spectrum, RED).fit.chi2_reduced > 3


def test_one_harmonic_is_refused() -> None:
    with pytest.raises(ParameterError, match="1 harmonics cannot tell motion from contrast"):
        fit_spot(
            decompose(record(TIME, np.zeros((1, TIME.size)), drive_frequency=[F]), n_harmonics=1),
            RED,
        )
