"""An edge that gives way to the film's pull."""

from dataclasses import replace

import numpy as np

from femnl.types.effect import Effect, Knob, Values
from femnl.types.readout import Array
from femnl.types.scene import ModalSystem

SPREAD = 0.75
"""Mean of cos⁴ + sin⁴ over all directions: the part of k² along the edge's normal where that varies."""
ROUNDS = 8


def loosen(system: ModalSystem, values: Values) -> ModalSystem:
    """Replace the clamp w = 0 by w = −δ ∂w/∂n, which lengthens the film by atan(kδ)/k at each edge.

    On a rectangle it acts along x and y apart, each a function of the operator −∂² in that direction. What it does to all long waves
    alike, L → L + 2δ, stays in the speed of waves.
    """
    depth = float(np.cbrt(values["depth_cubed"]))
    if depth == 0:
        return system
    if system.box is None:
        width = 2 * system.projection.reach
        k = system.wavenumber
        factor = _lowered(np.sqrt(SPREAD) * k, width, depth) / (np.sqrt(SPREAD) * k) * (1 + 2 * depth / width)
        return replace(system, stiffness=system.stiffness + np.diag(np.diag(system.stiffness) * (factor**2 - 1)))
    root = np.sqrt(np.diag(system.stiffness))
    along = system.projection.slopes[0, :2]
    total = np.sqrt(np.diag(along.sum(axis=0)))
    changed = np.zeros_like(system.stiffness)
    for slopes, width in zip(along, system.box, strict=True):
        # Shares of x and y in k², which holes change alike.
        squares, waves = np.linalg.eigh(np.outer(system.wavenumber, system.wavenumber) * slopes / np.outer(total, total))
        k = np.sqrt(np.maximum(squares, 0))
        changed += (waves * (_lowered(k, width, depth) ** 2 - k**2)) @ waves.T
    common = (1 + 2 * depth / np.sqrt(system.box[0] * system.box[1])) ** 2
    per = np.outer(root, root) / np.outer(system.wavenumber, system.wavenumber)
    stiffness = (system.stiffness + per * changed) * common
    return replace(system, stiffness=stiffness)


def _lowered(k: Array, width: float, depth: float) -> Array:
    """Solve k' L + 2 atan(k'δ) = kL."""
    found = k / (1 + 2 * depth / width)
    for _ in range(ROUNDS):
        found = found - (found * width + 2 * np.arctan(found * depth) - k * width) / (width + 2 * depth / (1 + (found * depth) ** 2))
    return np.asarray(found)


EFFECT = Effect(
    name="compliant_clamp",
    equation="edge w = 0 → w = −δ ∂w/∂n, δ = T/spring constant per length: kL + 2 atan(kδ) = mπ, less 2δ/L of all modes; s = δ³",
    parameters=(Knob("depth_cubed", "m^3", 0.0, 1e-14),),
    changes={"operators": loosen},
    source="string between springs, e.g. Morse & Ingard (1968), section 4.1, along x and along y",
    limits="an edge alike all around and without mass; on outlines other than rectangles the edge's direction is averaged over",
    sentence="the edge gives way, so that low modes reach further into it than high ones",
)
