"""
Mode shapes of a trampoline
===========================

A square pad on four tethers, clamped only at the tethers' ends.
"""

import femnl
from femnl.plot.mechanics import mode_gallery

modes = femnl.solve_modes(femnl.load("trampoline"), count=10)
print(modes)
figure = mode_gallery(modes, 10)
