"""Nonlinear resonators: all branches, sweeps, coupled modes, transients and ring-downs."""

from femnl.resonator.continuation import balance, curve, sweep_modes
from femnl.resonator.motion import integrate
from femnl.resonator.ringdown import ring_down
from femnl.resonator.roots import duffing_roots
from femnl.resonator.slow import branches, critical_alpha, critical_point, sweep
from femnl.resonator.system import couple

__all__ = [
    "balance",
    "branches",
    "couple",
    "critical_alpha",
    "critical_point",
    "curve",
    "duffing_roots",
    "integrate",
    "ring_down",
    "sweep",
    "sweep_modes",
]
