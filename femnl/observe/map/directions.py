"""How the residuals of a map answer to harmonics and places that are wrong."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from femnl.core.readout import Array, ComplexArray


def of_harmonics(
    harmonic: NDArray[np.int64], volts: ComplexArray, real: Callable[[ComplexArray], Array]
) -> dict[str, Array]:
    """Return the answers to a gain, a phase and a constant in each harmonic.

    Args: volts [V]: the prediction (n_harmonics, n_points). real: residuals of a change of it.
    """
    found: dict[str, Array] = {}
    for k, n in enumerate(harmonic):
        only, constant = np.zeros((2, *volts.shape), complex)
        only[k] = volts[k]
        constant[k] = 1.0
        found[f"gain of harmonic {n}"] = real(only)
        found[f"phase of harmonic {n}"] = real(1j * only)
        found[f"constant in harmonic {n}"] = real(constant)
        found[f"constant in quadrature of harmonic {n}"] = real(1j * constant)
    return found


def of_places(
    moved: Callable[[str, float], Array], step: float, across: Array, up: Array
) -> dict[str, Array]:
    """Return the answers to places that are wrong or blurred.

    Args: moved: change of the residuals by a step [m] of the base parameter `x` or `y`. across, up:
        x and y [m] of every residual.
    """
    found: dict[str, Array] = {}
    slopes = {}
    for axis in ("x", "y"):
        there, back = (moved(axis, side * step) for side in (1, -1))
        found[f"blur along {axis}"] = there + back
        slopes[axis] = there - back
    # A turn and a shear: on their own, x moved with y and y moved with x are all but the same
    # for most modes.
    return found | {
        "longer steps along x": across * slopes["x"],
        "longer steps along y": up * slopes["y"],
        "axes that are turned": up * slopes["x"] - across * slopes["y"],
        "axes at no right angle": up * slopes["x"] + across * slopes["y"],
    }
