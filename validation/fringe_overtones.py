"""How far the fringe of the paper's stack is from a sine."""

from collections.abc import Iterator

import numpy as np

import femnl
from femnl.validation import Case, Reference


def compute() -> Iterator[float]:
    """Read the overtones of R(u) of the shipped stack at both wavelengths."""
    for wavelength in (632.8e-9, 532e-9):
        strength = np.abs(
            femnl.MultilayerFringe(
                femnl.load("square-270um").stack, wavelength
            ).fourier.coefficients
        )
        yield from strength[2:4] / strength[1]


CASE = Case(
    claim="The fringe of film, gap and wafer has a second overtone of 23 % at 632.8 nm and of "
    "37 % at 532 nm",
    source="transfer matrices of the stack in arXiv:2502.19191, table of the reflectivity "
    "calculation, worked out "
    "independently",
    references=tuple(
        Reference(f"|c{overtone}/c1| at {wavelength} nm", value, absolute=0.0005)
        for wavelength, overtone, value in (
            ("632.8", 2, 0.230),
            ("632.8", 3, 0.053),
            ("532", 2, 0.370),
            ("532", 3, 0.137),
        )
    ),
    compute=compute,
)
