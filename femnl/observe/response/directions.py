"""Ways in which sweeps may deviate from any model of them."""

import numpy as np

from femnl.core.readout import Array, ComplexArray
from femnl.observe.response.sweeps import Sweeps

STRONG = (2, 8, 32)
"""Powers of a signal with which gain and phase may deviate: smoothly, or of the strongest alone."""


def directions_of_signal(
    sweeps: Sweeps, signal: ComplexArray, share: Array
) -> dict[str, ComplexArray]:
    """Return what another gain, phase or background does to the data (n_points,), by its name.

    Gain and phase may follow a power of the signal, and those and the background the drive.

    Args: signal (n_points,): as predicted, in σ; share (n_points,): its size over the largest.
    """
    found: dict[str, ComplexArray] = {}
    for power in STRONG:
        strong = signal * share**power
        found[f"gain as power {power} of the signal"] = strong
        found[f"phase as power {power} of the signal"] = 1j * strong
    for drive in np.unique(sweeps.drive):
        driven = f"at a drive of {drive * sweeps.reference:.3g} V"
        only = np.where(sweeps.drive == drive, signal, 0)
        flat = np.where(sweeps.drive == drive, 1 / sweeps.noise, 0j)
        found[f"gain {driven}"] = only
        found[f"phase {driven}"] = 1j * only
        found[f"real background {driven}"] = flat
        found[f"imaginary background {driven}"] = 1j * flat
    return found
