"""
Up and down through a stiffening resonance
==========================================

At some drive frequencies three motions are possible. The history then decides. In an upward sweep
the amplitude follows the upper branch until this branch ends, and then jumps.
"""

import numpy as np

from femnl.core.resonator import Resonator
from femnl.plot.style import new_figure, style
from femnl.resonator import critical_point, sweep

resonator = Resonator(frequency=1.466e6, quality_factor=10_000, alpha=6.9e9)
force, _, _ = critical_point(resonator)
frequency = resonator.frequency + resonator.linewidth * np.linspace(-4, 12, 300)

with style():
    figure = new_figure(5, 3)
    axes = figure.subplots()
    for factor, colour in ((1, "C0"), (2, "C1")):
        up = np.abs(sweep(resonator, factor * force, frequency))
        down = np.abs(sweep(resonator, factor * force, frequency[::-1]))[::-1]
        detuning = (frequency - resonator.frequency) / resonator.linewidth
        axes.plot(detuning, up * 1e9, color=colour, label=f"{factor} × critical force, up")
        axes.plot(detuning, down * 1e9, "--", color=colour, label="down")
    axes.set(xlabel="(f − f₀)/w", ylabel="amplitude (nm)")
    axes.legend()
