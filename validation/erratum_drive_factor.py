"""The factor of the driving force in the paper's amplitude A."""

from collections.abc import Iterator

import numpy as np

from femnl.core.resonator import Resonator
from femnl.resonator import branches, couple, integrate
from femnl.validation import Case, Reference

FORCE = 1.0
MODE = Resonator(frequency=1.0, quality_factor=20.0)


def compute() -> Iterator[float]:
    """Drive a linear mode at f₀ from rest for 150 periods, and read the last of them.

    Its transient has then decayed by e^−23.
    """
    unit = FORCE / (MODE.omega * MODE.damping)
    time = np.concatenate([[0.0], np.linspace(149, 150, 64, endpoint=False)])
    motion, _ = integrate(couple([MODE]), FORCE, MODE.frequency, 0.0, 0.0, time)
    yield float(2 * np.abs(np.mean(motion[0, 1:] * np.exp(-1j * MODE.omega * time[1:])))) / unit
    yield float(np.abs(branches(MODE, FORCE, [MODE.frequency]).amplitude[0, 0])) / unit


CASE = Case(
    claim="A force 𝓕 cos ωt drives u = ½A e^{iωt} + c.c. to |A| = 𝓕/ω₀γ at resonance, not "
    "half of it",
    source="closed form of the linear driven oscillator; arXiv:2502.19191, section on the "
    "Duffing resonator, "
    "equation for A",
    why="the equation carries 𝓕/2, which would be right for u = A e^{iωt} + c.c.; the "
    "Lorentzian forms "
    "that are "
    "fitted do not depend on it",
    references=(
        Reference("|A| ω₀γ/𝓕, integrated in time", 1.0, relative=1e-8, printed=0.5),
        Reference("|A| ω₀γ/𝓕, rotating wave", 1.0, relative=1e-12, printed=0.5),
    ),
    compute=compute,
)
