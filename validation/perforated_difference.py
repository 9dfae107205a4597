"""How holes and bending move f22 from 2 f11 in the whole perforated square."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

import femnl
from femnl.core.outline import Holes
from femnl.validation import Case, Reference

F11 = 1.466060e6


def compute() -> Iterator[tuple[float, float]]:
    """Solve 30 × 30 holes with bending (r = 0.9 µm), and without (r = 0.75 µm)."""
    model = femnl.load("square-270um-perforated")
    small = replace(model, bending=False, holes=Holes(np.array(model.holes.centres), 0.75e-6))
    for device in (model, small):
        modes = femnl.solve_modes(device, count=4, cache=False)
        yield (modes.ratio[3] - 2) * F11, modes.ratio_error[3] * F11


CASE = Case(
    claim="Relaxed holes add to f22 − 2 f11 instead of explaining the measured 249 Hz",
    source="independent finite-element models of the perforated square (pitch 8.56 µm, 30 × 30 "
    "holes, straight edge of 270 "
    "µm), scaled to "
    "the measured f11 = 1.466060 MHz of arXiv:2502.19191; given as about +970 Hz and about +107 "
    "Hz, read as ±2 %",
    references=(
        Reference("f22 − 2 f11, bending, r = 0.9 µm", 970.0, "Hz", relative=0.02),
        Reference("f22 − 2 f11, no bending, r = 0.75 µm", 107.0, "Hz", relative=0.02),
    ),
    compute=compute,
    slow=True,
)
