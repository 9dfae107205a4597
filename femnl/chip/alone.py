"""A device that deviates from its chip, diagnosed by the library with the chip as prior knowledge.

What the device shows beside its chip is laid on the simulated film of its design: what all devices
of the chip have in common, and the simulation has not, is no cause of this one.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import chdtrc

from femnl.chip.members import Chip
from femnl.chip.result import Cause, Deviation, Quantity
from femnl.chip.values import LEAST_SD, Array
from femnl.core.fit import Parameter
from femnl.core.numbers import scale_for, with_error
from femnl.device.geometry import load
from femnl.diagnose import diagnose
from femnl.fits.spectrum.labels import named_modes
from femnl.io import measurement
from femnl.observe.film import SimulatedFilm

if TYPE_CHECKING:
    from femnl.chip.hierarchy import Hierarchy
    from femnl.core.diagnosis import Diagnosis

FEWEST = 3
"""Modes of a device that its diagnosis needs."""
ALIKE = 0.01
"""Probability of the scatter of the modes about one factor, from which on they are off by it."""
UNKNOWN = ("other film or shape", "damaged")
"""Causes that say no more than that a frequency is off."""
MOST_RIVALS = 3
"""Sets of causes that are told beside the one that is named."""
MODES = 48
"""Simulated modes among which those of a device are found."""


def explained(cause: Cause, chip: Chip, frequency: Quantity, model: Hierarchy) -> Cause:
    """Return a cause with what the library makes of the device.

    The same where its frequencies say too little: of fewer than three modes, of a design without a
    geometry, or where another cause is known. Modes that are off alike name none, as another film
    does that, too.
    """
    own = [one for one in frequency.devices if one.device == cause.device]
    geometry = chip.geometries.get(own[0].design)
    if cause.name not in UNKNOWN or geometry is None or len(own) < FEWEST:
        return cause
    numbers = next(m.frequency for m in chip.members if m.name == cause.device)
    measured = np.array([numbers[one.mode].sd / numbers[one.mode].value for one in own])
    told = _told(cause, diagnosed(own, measured, geometry, model))
    if told.name == cause.name or not _alike(own, measured, model):
        return told
    words = f"{cause.words}; all its modes are off alike, as of another stress, density or size"
    return replace(cause, words=f"{words}; {told.name} may do the same")


def _alike(own: list[Deviation], measured: Array, model: Hierarchy) -> bool:
    """Whether the modes of a device are off by one factor, within what they scatter."""
    sd = _apart(measured, model)
    off = np.array([one.log_ratio for one in own])
    away = (off - np.average(off, weights=sd**-2)) / sd
    return bool(chdtrc(len(own) - 1, np.sum(away**2)) >= ALIKE)


def _apart(measured: Array, model: Hierarchy) -> Array:
    """Return by how much modes of one device deviate each for itself, relative (n,)."""
    _, between_modes = model.scatter
    return np.hypot(between_modes, np.maximum(measured, LEAST_SD))


def diagnosed(own: list[Deviation], measured: Array, geometry: str, model: Hierarchy) -> Diagnosis:
    """Diagnose a device by its deviations from its chip.

    f = f_simulated · f_measured/f_predicted of each mode, with the scatter between modes of one
    device and the error of measurement as its noise. The speed of waves is that of the film to the
    spread from device to device.

    Args: own: the modes of the device. measured (n,): relative errors of their frequencies.
        geometry: of its design. model: of the devices that do not deviate.
    """
    film = SimulatedFilm.of_one_material(load(geometry), MODES)
    names = [one.mode for one in own]
    numbered = all(name.isdecimal() for name in names)
    order = [int(n) - 1 for n in names] if numbered else named_modes(tuple(names), film).order
    simulated = film.modes.frequency[order]
    found = simulated * np.exp([one.log_ratio for one in own])
    common, _ = model.scatter
    labels = [f"mode {name}" for name in names] if numbered else names
    sd = simulated * _apart(measured, model)
    group = measurement.spectrum(found, sd, labels).assign_attrs(
        wave_speed=film.speed, wave_speed_sd=film.speed * common
    )
    with TemporaryDirectory(prefix="femnl-") as folder:
        path = Path(folder) / "device.nc"
        measurement.write(measurement.bundle({"spectrum": group}), path)
        return diagnose(path, geometry)


def _told(cause: Cause, found: Diagnosis) -> Cause:
    """Return the cause that a diagnosis names, with its parameters in words."""
    if not found.causes:
        words = f"{cause.words}; no cause of the library explains its modes"
        return replace(cause, words=words)
    own = " + ".join(found.causes)
    rivals = found.alternatives if found.verdict == "ambiguous" else ()
    others = [" + ".join(rival.causes) for rival in rivals if rival.causes != found.causes]
    beside = f"; {', '.join(others[:MOST_RIVALS])} may do the same" if others else ""
    parameters = ", ".join(
        f"{p.name} {_readable(p)}" for name in found.causes for p in found.parameters[name].values()
    )
    words = f"{cause.words}; its modes deviate as this makes them ({parameters}){beside}"
    return replace(cause, name=own, words=words)


def _readable(parameter: Parameter) -> str:
    scale = scale_for(parameter.value, parameter.unit)
    number = with_error(parameter.value / scale.size, parameter.sd / scale.size, 2)
    return f"{number} {scale.unit}".rstrip()
