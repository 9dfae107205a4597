"""Records of decays with a known quality factor.

They are made in amplitude, with a drive that feeds through and filtered noise; they share no
formula with the model but e^{−γt/2}.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from femnl import measurement
from femnl.core.decay import DecayFit
from femnl.fits.decay.power import fit_decay

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
TONE = 1e6
QUALITY = 1e7
RATE = 2 * np.pi * TONE / QUALITY


def record(
    seed: int,
    envelope: Complex | None = None,
    *,
    length: float = 12.0,
    floor: float = 1e-6,
    correlation: float = 2.0,
    points: int = 600,
) -> tuple[Array, Array, int]:
    """Return times [s], power [dB] and the point of switch-off: floor, drive, decay, floor.

    Args: envelope: amplitude (n,) after the switch-off, straight where None; length: of the record
    in 1/γ; floor: power of the noise; correlation: of the noise [points].
    """
    rng = np.random.default_rng(seed)
    time = np.arange(points) * length / RATE / points
    begin = points // 6
    amplitude = np.zeros(points, dtype=complex)
    after = time[begin:] - time[begin]
    amplitude[begin:] = np.exp(-RATE * after / 2) if envelope is None else envelope
    # The drive's own feed-through stands 10 dB above the mode and goes at once.
    amplitude[points // 20 : begin] = np.sqrt(10)
    white = rng.normal(size=(2, points + 100))
    memory = np.exp(-1 / correlation)
    slow = lfilter([np.sqrt(1 - memory**2)], [1, -memory], white, axis=1)[:, 100:]
    amplitude += np.sqrt(floor / 2) * (slow[0] + 1j * slow[1])
    return time, 20 * np.log10(np.abs(amplitude)), begin


def fitted(time: Array, power: Array) -> DecayFit:
    """Fit a record of the mode."""
    return fit_decay(measurement.decay(time, power, attributes={"frequency": TONE}))


def pull(fit: DecayFit, quality: float = QUALITY) -> float:
    """Return how many standard deviations Q is off."""
    found = fit.fit.parameters["quality_factor"]
    return (found.value - quality) / found.sd
