"""The shortest waves that a mesh has to follow."""

import numpy as np

from femnl.core.device import Model
from femnl.core.errors import ParameterError
from femnl.core.outline import Segment
from femnl.device.geometry import curves
from femnl.device.geometry.validity import FINEST

ELEMENTS = 3.5
"""Elements of degree 4 a wavelength: 200 modes of a square are then right to 1e-6, and degrees 3
and 2, from which errors are estimated, still find the same modes."""
FEWEST = 2.5
"""Elements a wavelength also at low resolutions: with fewer than 1.8, high modes of degree 4 have
no counterpart of degree 3, and no known error."""
SAMPLES = 33  # points along an arc by which its length is known to a few parts in a thousand


def shortest_wave(model: Model, count: int) -> float:
    """Return the wavelength [m] of the highest of the `count` lowest modes.

    Of the wave number k in N = (A k² − P k) / 4π, with the area A of the film and the length P of
    its clamped edges less that of the outline's free ones. Free rims of holes are left out: waves
    longer than a hole pass it by.

    Source: Weyl's law with its second term, Ivrii, Funct. Anal. Appl. 14, 98 (1980).
    """
    outline = model.edge_outline
    area = curves.area(outline) - sum(curves.area(rim) for rim in model.openings)
    inner = [s for rim in model.openings for s in rim.segments if s.clamped]
    held = sum(_length(s) for s in inner)
    held += sum(_length(s) if s.clamped else -_length(s) for s in outline.segments)
    half = held / (2 * area)
    return float(2 * np.pi / (half + np.sqrt(half**2 + 4 * np.pi * count / area)))


def elements_a_wave(resolution: float) -> float:
    """Return how many elements shall follow the shortest wave at a resolution."""
    return max(ELEMENTS * resolution, FEWEST)


def wave_at(model: Model, frequency: float) -> float:
    """Return the wavelength √(σ/ρ)/f [m] in the film before release.

    Bending makes waves longer.
    Raises: ParameterError where no mesh follows them.
    """
    wave = float(np.sqrt(model.film.stress / model.film.density) / frequency)
    if wave < FINEST * model.outline.length:
        raise ParameterError(
            f"frequency = {frequency:g} Hz: its waves are shorter than {FINEST:g} of the film's "
            "length, which no mesh follows; give a lower one"
        )
    return wave


def _length(segment: Segment) -> float:
    points = curves.point_at(segment, np.linspace(0, 1, SAMPLES))
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
