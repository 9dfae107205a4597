"""
What does the simulation get wrong?
===================================

The reflection of the whole stack reads the maps of a membrane over a wafer. The base model of the
diagnosis reads with one sine. The diagnosis reports the deviations, the cause that explains them,
and the gain on parts of the map that no fit has used.
"""

import tempfile
from pathlib import Path

import numpy as np

import femnl
from femnl import measurement
from femnl.diagnose import diagnose
from femnl.plot.comparison import comparison_figure

amplitude = 397e-9
wavelength = 632.8e-9
noise = 2e-4
device = femnl.load("square-270um")
modes = femnl.solve_modes(device, 12)
axis = np.linspace(-135e-6, 135e-6, 41)
shape = femnl.mechanics.modes.shape_at(modes, 0, axis[None, :], axis[:, None])

# What a photodiode sees over one period, and its harmonics: nothing of the models that the
# diagnosis fits.
time = 2 * np.pi * np.arange(128) / 128
fringe = femnl.MultilayerFringe(device.stack, wavelength)
volts = 0.05 * fringe(amplitude * shape * np.cos(time)[:, None, None])
harmonics = 2 * np.fft.fft(volts, axis=0)[1:5] / len(time)
rng = np.random.default_rng(1)
harmonics += noise * (rng.normal(size=harmonics.shape) + 1j * rng.normal(size=harmonics.shape))

with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "maps.nc"
    maps = measurement.harmonic_map(
        axis, axis, [1, 2, 3, 4], harmonics, noise_sd=noise, wavelength=wavelength
    )
    measurement.write(measurement.bundle({"map": maps}, geometry="square-270um"), path)
    found = diagnose(path)

print(found.verdict, found.causes, f"gain {found.gain:.3g}")
print(found.where)
print(
    f"amplitude {found.parameters['base']['amplitude'].value * 1e9:.2f} nm, put in "
    f"{amplitude * 1e9:.0f} nm"
)
figure = comparison_figure(found.comparisons[0])
