"""
The origin of the 21st harmonic
===============================

At this drive, one sine has next to nothing above the 12th harmonic. The reflection of a film above
a wafer is not a sine. Its overtones produce harmonics to n = 21 and beyond, as in the measurement.
"""

import numpy as np

import femnl
from femnl.optics.harmonics import harmonics
from femnl.plot.spectrum import harmonic_spectrum_figure

amplitude = 446e-9
wavelength = 632.8e-9
stack = femnl.load("square-270um").stack
orders = np.arange(1, 26)
sine = femnl.SineFringe(wavelength, offset=0.0, contrast=1.0, phase=np.pi / 4)
fringes: dict[str, femnl.SineFringe | femnl.MultilayerFringe] = {
    "sine": sine,
    "stack of layers": femnl.MultilayerFringe(stack, wavelength),
}
strengths = {name: np.abs(harmonics(fringe, orders, amplitude)) for name, fringe in fringes.items()}
figure = harmonic_spectrum_figure(
    orders, {name: values / values.max() for name, values in strengths.items()}, level=0.01
)
