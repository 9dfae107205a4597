"""An edge that gives way to the film's pull."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.memo import recent
from femnl.core.readout import Array
from femnl.core.stages import ModalSystem

SPREAD = 0.75
"""Mean of cos⁴ + sin⁴ over all directions: the part of k² along the edge's normal where that
varies.
"""
ROUNDS = 8
STEP = 1e-4
"""Part of ℓ by which the energy of bending is found."""


def loosen(system: ModalSystem, values: Values) -> ModalSystem:
    """Replace the clamp w = 0 by springs of T/δ per length.

    They lengthen the film by atan k(δ − ℓ)/k instead of −atan(kℓ)/k at each edge, and the wave is
    less steep there, so that the layer bends less: its energy is ∂K/∂ln ℓ² with δ as it is.
    """
    if values["depth_cubed"] == 0:
        return system
    layer = system.bending_length
    depth = float(layer + np.cbrt(values["depth_cubed"] - layer**3))
    loose = _between_springs(system, depth)
    if layer == 0:
        return replace(system, stiffness=loose)
    stiffer = system.bent(layer * (1 + STEP))
    bending = _between_springs(stiffer, depth) - loose
    clamped = np.diag(stiffer.stiffness - system.stiffness)
    plain = np.diag(system.stiffness)
    # What would be K were the part of bending in it as in a film that is clamped
    followed = bending * np.sqrt(np.outer(plain / clamped, plain / clamped))
    unfollowed = (loose - followed) - (system.stiffness - np.diag(plain))
    return replace(system, stiffness=loose, unbent=system.unbent + unfollowed)


def _between_springs(system: ModalSystem, depth: float) -> Array:
    """Return the stiffness (n, n) of a film between springs.

    On a rectangle they act along x and y apart, each a function of the operator −∂² in that
    direction. What they do to all long waves alike, L → L + 2δ, stays in the speed of waves unless
    that is known. The shear force of the layer at the edge, −Dw‴, stretches δ by 1 + 2ℓ²k².
    """
    layer = system.bending_length
    # Of k² + ℓ²k⁴ = (ω/c)²
    k2 = 2 * system.wavenumber**2 / (1 + np.sqrt(1 + 4 * layer**2 * system.wavenumber**2))
    shear = 4 * depth * layer**2
    if system.box is None:
        width = 2 * system.projection.reach
        longer = (1 + 2 * depth / width) ** 2
        common = 1.0 if system.speed_known else longer
        low = _lowered(np.sqrt(SPREAD * k2), width, depth, layer) ** 2
        loose = (
            low
            / SPREAD
            * (
                1
                - 2
                * shear
                / (width + 2 * (depth - layer))
                * k2
                / longer
                / (1 + low * (depth - layer) ** 2)
            )
        )
        factor = (loose + layer**2 * loose**2) / (k2 + layer**2 * k2**2) * common
        return np.asarray(system.stiffness + np.diag(np.diag(system.stiffness) * (factor - 1)))
    root = np.sqrt(np.diag(system.stiffness))
    along = system.projection.slopes[0, :2]
    total = np.sqrt(np.diag(along.sum(axis=0)) / k2)
    longer = (1 + 2 * depth / np.sqrt(system.box[0] * system.box[1])) ** 2
    common = 1.0 if system.speed_known else longer
    before, after, moved = (np.zeros_like(system.stiffness) for _ in range(3))
    for slopes, width in zip(along, system.box, strict=True):
        # Shares of x and y in k², which holes change alike.
        squares, waves = _waves(slopes, total)
        low = _lowered(np.sqrt(np.maximum(squares, 0)), width, depth, layer) ** 2
        before += (waves * squares) @ waves.T
        after += (waves * low) @ waves.T
        moved += (
            waves * (shear * low / (1 + low * (depth - layer) ** 2) / (width + 2 * (depth - layer)))
        ) @ waves.T
    after -= moved * np.add.outer(np.diag(after), np.diag(after))
    changed = (after + layer**2 * after @ after) - (before + layer**2 * before @ before)
    return np.asarray(
        (
            system.stiffness
            + np.outer(root, root) / np.outer(system.wavenumber, system.wavenumber) * changed
        )
        * common
    )


def _directed(slopes: Array, total: Array) -> tuple[Array, Array]:
    """Return k² along one direction and its waves on the base modes, whatever the edge does."""
    squares, waves = np.linalg.eigh(slopes / np.outer(total, total))
    return np.asarray(squares), np.asarray(waves)


_waves = recent(_directed)


def _lowered(k: Array, width: float, depth: float, layer: float) -> Array:
    """Solve k' L + 2 atan k'(δ − ℓ) = kL − 2 atan kℓ."""
    phase = k * width - 2 * np.arctan(k * layer)
    more = depth - layer
    found = phase / (width + 2 * more)
    for _ in range(ROUNDS):
        found = found - (found * width + 2 * np.arctan(found * more) - phase) / (
            width + 2 * more / (1 + (found * more) ** 2)
        )
    return np.asarray(found)


EFFECT = Effect(
    name="compliant_clamp",
    accuracy=0.05,
    accuracy_reason="an edge that yields alike all around; a ledge is no row of springs",
    imitates={
        "spectrum": {
            "aspect_ratio": 1.0,
            "yielding_edge": 1.0,
            "stress_anisotropy": 0.96,
            "hole_dispersion": 0.68,
            "bending_stiffness": 0.6,
            UNKNOWN: 0.31,
        }
    },
    equation="edge w = 0 → −δ ∂w/∂n, δ = T/springs per length: kL + 2 atan k(δ − ℓ) = mπ, less "
    "2δ/L of all modes where the speed of waves is not known; s = (δ − ℓ)³ + ℓ³; "
    "1/Q ∝ ∂ln ω²/∂ln ℓ² at this δ",
    parameters=(
        ParameterSpec(
            "depth_cubed",
            "m^3",
            0.0,
            1.25e-16,
            reason="δ ≤ 5 µm: an etch through a wafer of 500 µm that is a hundred times slower on "
            "the (111) walls, as slow ones in KOH are, takes that much sideways off under the "
            "film; a rigid frame has δ of nanometres",
        ),
    ),
    changes={"operators": loosen},
    source="string between springs along x and along y, T ∂w/∂n = −(springs) w at its ends: "
    "w ∝ sin(kx + atan kδ); a stiff one that cannot turn at its ends, and bends least where "
    "the wave is least steep, so that short waves gain most in Q",
    limits="an edge alike all around, without mass, that moves and does not turn; its direction is "
    "averaged over but on rectangles. Mode m shifts by ⅔ (mπ)² s/L³ against a wave so long that "
    "L + 2δ is all it sees: δ = 12 nm, a ledge's, shows in no frequency, and a film of 270 µm "
    "takes δ above 1 µm to shift its modes up to m = 5 by parts in 10⁶",
    sentence="the edge gives way, so that low modes reach further into it than high ones",
    one_material=True,
)
