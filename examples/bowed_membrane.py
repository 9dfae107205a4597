"""
A membrane that is bent at rest
===============================

Pressure, gravity or a charge bend the film. The film gets stiffer. A force of second order appears
and softens it at large motion: α falls, and finally the stiffening resonance becomes a softening
one. Dashed: k₃/k − (10/9)(k₂/k)² with k + 3k₃b² and 3k₃b. This is the effect of a static deflection
b in the mode's own shape on that mode alone. Near 5 µm twice the frequency meets another mode, and
the deflection couples both. They exchange energy, and α does not describe this.
"""

from dataclasses import replace

import numpy as np

import femnl
from femnl.plot.style import new_figure, style

model = replace(femnl.load("square-270um"), bending=False)
modes = replace(femnl.solve_modes(model, count=1), coarse=None)  # without error bars
flat = femnl.solve_nonlinearity(modes).alpha[0]
depth = np.linspace(0, 6e-6, 37)
rows = [femnl.solve_static_deflection(modes, depth=b) for b in depth]

with style():
    figure = new_figure(7.2, 2.9)
    left, right = figure.subplots(1, 2)
    left.plot(depth * 1e6, [bowed.frequency[0] / 1e6 for bowed in rows], color="C0")
    left.set(xlabel="bow (µm)", ylabel="f (MHz)")
    right.axhline(0, color="#999999", linewidth=0.6)
    right.plot(
        depth * 1e6, [bowed.alpha[0] * 1e-12 for bowed in rows], color="C0", label="all modes"
    )
    rise = 1 + 3 * flat * depth**2
    right.plot(
        depth * 1e6,
        (flat / rise - 10 * (flat * depth / rise) ** 2) * 1e-12,
        "--",
        color="C1",
        label="the mode alone",
    )
    right.set(xlabel="bow (µm)", ylabel="α (µm⁻²)", ylim=(-0.004, 0.0075))
    right.legend()
