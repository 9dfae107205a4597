"""Sweeps beside what models predict, as curves of magnitude and phase."""

import numpy as np

from femnl.core.comparison import Comparison, Curve, Curves
from femnl.core.numbers import engineering, signed
from femnl.core.readout import Array, ComplexArray
from femnl.observe.residuals import Quantity, quadratures
from femnl.observe.response.sweeps import Sweeps


def curves(sweeps: Sweeps, names: tuple[str, ...], volts: ComplexArray) -> tuple[Comparison, ...]:
    """Return magnitude and phase of every sweep.

    Args: names: of the models; volts (n_models, n_points): what they predict [V].
    """
    size = np.abs(sweeps.voltage)
    noise = np.full(sweeps.voltage.shape, sweeps.noise)
    turns = [np.unwrap(np.angle(sweeps.voltage[span])) for span in sweeps.spans]
    phase = np.degrees(np.concatenate(turns))
    near = phase + np.degrees(np.angle(volts * np.conj(sweeps.voltage)))
    found = []
    for what, unit, measured, sd, predicted in (
        ("magnitude", "V", size, noise, np.abs(volts)),
        ("phase", "°", phase, np.degrees(noise / np.maximum(size, noise)), near),
    ):
        drawn = tuple(
            Curve(sweep_name(sweeps, k), sweeps.frequency[s], measured[s], sd[s], predicted[:, s])
            for k, s in enumerate(sweeps.spans)
        )
        found.append(Curves("response", "frequency", "Hz", what, unit, names, drawn))
    return tuple(found)


def sweep_name(sweeps: Sweeps, k: int) -> str:
    """Name a sweep by its drive and direction."""
    drive = sweeps.drive[sweeps.spans[k].start] * sweeps.reference
    return f"{drive:.3g} V {({1: 'up', -1: 'down'}).get(sweeps.direction[k], '')}".strip()


def voltages(sweeps: Sweeps) -> tuple[Quantity, ...]:
    """Return what was measured: both quadratures, by sweep, place, drive and frequency."""
    place = sweeps.positions[sweeps.position]
    axes = {
        "sweep": (sweeps.sweep + 1, ""),
        "x": (place[:, 0], "m"),
        "y": (place[:, 1], "m"),
        "drive": (sweeps.drive * sweeps.reference, "V"),
        "frequency": (sweeps.frequency, "Hz"),
    }
    return quadratures("signal", "V", np.full(len(sweeps.frequency), sweeps.noise), axes)


def described(sweeps: Sweeps, residuals: Array, resonance: float) -> str:
    """Say at which drive and on which side of the resonance [Hz] the sweeps deviate."""
    n = len(sweeps.frequency)
    power = (residuals[:n] ** 2 + residuals[n : 2 * n] ** 2) / 2
    rms = {
        drive: float(np.sqrt(power[sweeps.drive == drive].mean()))
        for drive in np.unique(sweeps.drive)
    }
    worst = max(rms, key=lambda drive: rms[drive])
    k = int(np.argmax(np.where(sweeps.drive == worst, power, -1.0)))
    table = ", ".join(
        f"{engineering(drive * sweeps.reference, 'V')}: {value:.2f}σ"
        for drive, value in rms.items()
    )
    offset = sweeps.frequency[k] - resonance
    most = f"the drive of {engineering(worst * sweeps.reference, 'V')} deviates most"
    return f"{most}, most strongly {signed(offset, 'Hz')} from resonance; rms by drive {table}"
