"""
What an interferometer shows of a strongly driven membrane
==========================================================

The centre of the film moves by 446 nm, which is most of a wavelength there and back. The readout
causes the rings, not the membrane.
"""

import femnl
from femnl import measurement
from femnl.device.geometry.curves import polyline
from femnl.plot.maps import harmonic_map_figure

model = femnl.load("square-270um")
modes = femnl.solve_modes(model, count=1)
fringe = femnl.SineFringe(wavelength=632.8e-9, offset=0.0, contrast=1.0, phase=0.8)
maps = femnl.harmonic_maps(modes, 0, fringe, amplitude=446e-9, wavelength=632.8e-9)
print(maps)

# %%
# The maps are a measurement like any other, and are drawn as one.

dataset = measurement.harmonic_map(
    maps.x, maps.y, maps.harmonic, maps.values, wavelength=maps.wavelength
)
figure = harmonic_map_figure(dataset, polyline(model.outline))
