"""Coupled modes: how they are put together, and their restoring forces in dimensionless form."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np
from numpy.typing import ArrayLike

from femnl.core.errors import ParameterError
from femnl.core.resonator import Array, CoupledModes, Resonator


def couple(
    resonators: Sequence[Resonator],
    effective_mass: ArrayLike | None = None,
    quadratic: Mapping[tuple[int, int, int], float] | None = None,
    cubic: Mapping[tuple[int, int, int, int], float] | None = None,
) -> CoupledModes:
    """Join modes by entries of the fully symmetric force tensors.

    Mᵢ q̈ᵢ ∋ −Σ K2ᵢⱼₖ qⱼqₖ − Σ K3ᵢⱼₖₗ qⱼqₖqₗ.

    One entry stands for all permutations of its indices: (i,i,j,j) in K3 is the dispersive
    coupling, (i,i,j) in K2 a 1:2 and (i,i,i,j) in K3 a 1:3 resonance. The modes' own k₂ and k₃ come
    from `resonators`.

    Args:
        resonators: the uncoupled modes.
        effective_mass: mᵢ [kg]; needed where there is a coupling.
        quadratic: K2 by index triple [N/m²]; `Nonlinearity.tensor` holds K3.
        cubic: K3 by index quadruple [N/m³].
    """
    n = len(resonators)
    omega = np.array([mode.omega for mode in resonators])
    mass = np.full(n, np.nan) if effective_mass is None else np.asarray(effective_mass, dtype=float)
    if mass.shape != (n,) or ((quadratic or cubic) and not np.all(mass > 0)):
        raise ParameterError(
            f"effective_mass = {mass}: give one positive mass in kg for each of the {n} "
            "coupled modes"
        )
    second = np.zeros((n,) * 3)
    third = np.zeros((n,) * 4)
    for tensor, entries in ((second, quadratic or {}), (third, cubic or {})):
        for index, value in entries.items():
            if (
                len(index) != tensor.ndim
                or len(set(index)) == 1
                or not all(0 <= i < n for i in index)
            ):
                raise ParameterError(
                    f"coupling {index}: give {tensor.ndim} indices of modes 0 … {n - 1}, not "
                    "all equal"
                )
            for order in set(permutations(index)):
                tensor[order] = value / mass[order[0]]
    for i, mode in enumerate(resonators):
        second[(i,) * 3] = omega[i] ** 2 * mode.quadratic
        third[(i,) * 4] = omega[i] ** 2 * mode.alpha
    return CoupledModes(
        np.array([mode.frequency for mode in resonators]),
        np.array([mode.damping for mode in resonators]),
        second,
        third,
        np.array([mode.omega**2 * mode.quintic for mode in resonators]),
        np.array([mode.nonlinear_damping for mode in resonators]),
    )


def scaled(modes: CoupledModes, length: float, rate: float) -> CoupledModes:
    """Return the same modes in units of `length` [m] and of time 1/`rate` [rad/s]."""
    return replace(
        modes,
        frequency=modes.frequency / rate,
        damping=modes.damping / rate,
        quadratic=modes.quadratic * (length / rate**2),
        cubic=modes.cubic * (length / rate) ** 2,
        quintic=modes.quintic * (length**2 / rate) ** 2,
        nonlinear_damping=modes.nonlinear_damping * length**2,
    )


def nonlinear_force(modes: CoupledModes, q: Array, v: Array) -> Array:
    """Return the nonlinear terms (n, t) at displacements q and velocities v (n, t)."""
    quintic = modes.quintic[:, None]
    damping = (modes.damping * modes.nonlinear_damping)[:, None]
    tangent = np.einsum("ijk,kt->ijt", modes.quadratic, q) + np.einsum(
        "ijkl,klt->ijt", modes.cubic, q[:, None] * q
    )
    return np.asarray(np.einsum("ijt,jt->it", tangent, q) + quintic * q**5 + damping * q**2 * v)


def nonlinear_slopes(modes: CoupledModes, q: Array, v: Array) -> tuple[Array, Array]:
    """Return the derivatives of `nonlinear_force`.

    By displacement (n, n, t) and by the mode's own velocity (n, t).
    """
    quintic = modes.quintic[:, None]
    damping = (modes.damping * modes.nonlinear_damping)[:, None]
    stiffness = 2 * np.einsum("ijk,kt->ijt", modes.quadratic, q) + 3 * np.einsum(
        "ijkl,klt->ijt", modes.cubic, q[:, None] * q
    )
    own = np.arange(modes.count)
    stiffness[own, own] += 5 * quintic * q**4 + 2 * damping * q * v
    return stiffness, damping * q**2
