"""Dissipation dilution: how far tension lifts Q above that of the bending film."""

import numpy as np
from numpy.typing import NDArray

from femnl.core.device import Model
from femnl.core.discretisation_error import remainder
from femnl.core.errors import ParameterError
from femnl.core.modes import STEADY, Modes
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import cells, curvature, quadrature_order, slope
from femnl.mechanics.fem.sheet import Sheet
from femnl.mechanics.fem.stress import relaxed_tension
from femnl.mechanics.fem.supports import deflection_springs, slope_springs

Array = NDArray[np.float64]


def bending_share(modes: Modes) -> Array:
    """Part of the elastic energy of each mode that is stored in bending.

    Clamped edges and rims of holes included.

    s = 1 − (∫ N : ∇ξ⊗∇ξ + ∮ k ξ² + k_θ (∂ₙξ)²) / (m_eff ω²), which is ∂ ln ω² / ∂ ln D at a fixed
    tension N and fixed springs.

    Args: modes: of any wedge. Returns: (n_modes,), NaN where a mode has no frequency.
    """
    domain = modes.domain
    space = Space(modes.domain.mesh, modes.degree)
    order = quadrature_order(domain.model, 2 * modes.degree)
    springs = deflection_springs(space, domain.model.clamp) + slope_springs(
        space, domain.model.clamp
    )
    tension = np.einsum("ni,ni->n", modes.shapes, (springs @ modes.shapes.T).T)
    for cell, pull in zip(
        cells(space, order), relaxed_tension(modes.prestress, order), strict=True
    ):
        slopes = np.einsum(
            "eqxj,nej->neqx",
            slope(cell.jet),
            modes.shapes[:, space.dofs[cell.triangles]],
            optimize=True,
        )
        xx, yy, xy = np.moveaxis(pull, -1, 0)
        energy = (
            xx * slopes[..., 0] ** 2
            + yy * slopes[..., 1] ** 2
            + 2 * xy * slopes[..., 0] * slopes[..., 1]
        )
        tension += np.einsum("neq,eq->n", energy, cell.dx)
    return np.asarray(1 - domain.copies * tension / modes.stiffness)


def bending_shares(modes: Modes) -> Array:
    """Part of the elastic energy of each mode that film and layers store as they bend.

    (1 + n_layers, n_modes), which sums to `bending_share`: that, divided as ∫ κ : Dᵢ : κ of each
    divides the curvature's energy ∫ κ : D : κ. Dᵢ: `Sheet.bending_parts`.
    """
    domain = modes.domain
    space = Space(domain.mesh, modes.degree)
    sheet = Sheet(domain)
    order = quadrature_order(domain.model, 2 * modes.degree)
    energy = np.zeros((1 + len(domain.model.layers), len(modes.frequency)))
    for cell in cells(space, order, second=True):
        bent = np.einsum(
            "eqxj,nej->neqx",
            curvature(cell.jet),
            modes.shapes[:, space.dofs[cell.triangles]],
            optimize=True,
        )
        parts = sheet.bending_parts(cell.triangles, cell.jet.point)
        for k, moduli in enumerate(parts):
            moment = np.einsum("eqxy,neqy->neqx", moduli, bent)
            energy[k] += np.einsum("neqx,neqx,eq->n", moment, bent, cell.dx)
    return np.asarray(bending_share(modes) * energy / energy.sum(axis=0))


def refuse_without_bending(model: Model) -> None:
    """Refuse a film whose motion loses nothing. Raises: ParameterError."""
    if not model.bending:
        raise ParameterError(
            f"{model.name}: bending = false leaves nothing that loses energy; set bending = true"
        )


def dilution(modes: Modes) -> tuple[Array, Array]:
    """Return the dissipation dilution Q/Q_bend of each mode.

    Q_bend = 1/φ is the quality factor of bending alone, E → E(1 + iφ).

    Q/Q_bend = 1/s with s of `bending_share`; for a square membrane about 1/(λ + λ²π²(m² + n²)/4), λ
    = 2ℓ/L, ℓ = √(D/σh): the first term is the clamped edge's, the second that of the antinodes.

    Args: modes: with bending. Returns: (n_modes,), and its discretisation error, an upper estimate,
    infinite without counterparts.
    Raises: ParameterError where the model has no bending.
    Valid: small φ; static stress without loss; no gas, no radiation into the frame. In-plane motion
    adds no loss at small amplitude.
    Source: Yu, Purdy and Regal, Phys. Rev. Lett. 108, 083603 (2012); held against clamped circular
        plates by tests/physics/test_dilution.py and validation case `dissipation_dilution`.
    """
    refuse_without_bending(modes.domain.model)
    shares = [bending_share(grade) for grade in modes.grades]
    error = (
        remainder(shares[:3], shares[0], STEADY)
        if len(shares) > 1
        else np.full(len(shares[0]), np.inf)
    )
    return 1 / shares[0], np.asarray(error / shares[0] ** 2)
