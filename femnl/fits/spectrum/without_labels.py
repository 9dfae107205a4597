"""Which modes lines without labels are, for a diagnosis: the lowest ones, or with some missing."""

import numpy as np
from numpy.typing import NDArray

from femnl.core.readout import Array
from femnl.fits.spectrum.assignment import MOST_LINES, assign
from femnl.fits.spectrum.film import MARGIN
from femnl.observe.film import SimulatedFilm
from femnl.observe.spectrum.matching import ranks

FAR = ((7, 0.003), (4, 0.03))
"""From how many lines on, and from which scatter of the logarithms of measured over simulated
frequency on, lines may be others than the lowest modes. Causes of the library change ratios by up
to some per cent, and few lines may meet other modes by chance.
"""
FAR_LESS = 0.1
"""Part of that scatter which another assignment may leave."""
SURE = 0.9
"""Least probability of it, where modes that frequencies hardly tell apart count as one."""


def modes_of(
    frequency: Array, sd: Array, film: SimulatedFilm
) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """Return the mode (n,) of each line without a label, and what there is to tell of that.

    They are the lowest modes, unless these are far off and another assignment is not.

    Args: frequency and sd (n,) [Hz].
    """
    lowest = ranks(frequency)
    simulated = film.modes.frequency
    scatter = _scatter(frequency, simulated[lowest])
    far = [least for count, least in FAR if len(frequency) >= count]
    if not far or scatter < min(far) or len(frequency) > MOST_LINES:
        return lowest, ()
    names = [f"({k + 1})" for k in range(len(simulated))]
    band = ((1 - MARGIN) * frequency.min(), (1 + MARGIN) * frequency.max())
    found = assign(frequency, sd, names, simulated, band)
    if None in found.best.mode or found.up_to_ambiguous < SURE:
        return lowest, ()
    modes = np.array(found.best.mode, np.int64)
    if _scatter(frequency, simulated[modes]) > FAR_LESS * scatter:
        return lowest, ()
    told = (
        f"spectrum: its lines leave the ratios of the lowest modes by {scatter:.1%}, and are taken "
        f"for modes {', '.join(names[k] for k in np.sort(modes))}; label them where that is wrong"
    )
    return modes, (told,)


def _scatter(frequency: Array, simulated: Array) -> float:
    """Return the standard deviation of the logarithm of measured over simulated frequency."""
    return float(np.std(np.log(frequency / simulated)))
