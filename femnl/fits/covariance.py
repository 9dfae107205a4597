"""Uncertainties of a least-squares fit from its Jacobian; undetermined parameters are named."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from femnl.core.fit import Parameter
from femnl.core.readout import Array

Complex = NDArray[np.complex128]
STEP = 1e-30
"""Imaginary step of derivatives, so small that it loses nothing."""

BLIND = 1e-9
"""Eigenvalues of the scaled Fisher information below this are directions that the data do not see.
"""


def unseen(jacobian: Array, unit: Array) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return which parameters the data do not see at all.

    A step of such a parameter by its natural `unit` moves χ² by less than a millionth.
    """
    return np.asarray(np.linalg.norm(jacobian, axis=0) * unit < 1e-3)


def natural_units(jacobian: Array, data: Array) -> Array:
    """Return the step (k,) of each parameter that moves data (n,) by as much as they hold.

    It does for a parameter that ends at 0, whose own value says nothing. It is 0 where the data do
    not move. Args: jacobian (n, k), in the unit of the data.
    """
    size = np.linalg.norm(jacobian, axis=0)
    moving = size > 0
    return np.where(moving, np.linalg.norm(data) / np.where(moving, size, 1.0), 0.0)


def covariance(jacobian: Array, names: Sequence[str], unit: Array) -> tuple[Array, tuple[str, ...]]:
    """Return (JᵀJ)⁻¹ over what the data determine, and sentences on what they do not.

    The Fisher information is scaled to a unit diagonal; eigenvectors with an eigenvalue below 1e-9
    are exact degeneracies. Every parameter that takes part in one gets an infinite variance, the
    others their variance given that degeneracy.

    Args:
        jacobian: derivatives of the residuals in standard deviations, (n_points, n_parameters).
        names: parameter names.
        unit: a step of each parameter that would matter, (n_parameters,).

    Returns:
        covariance (n_parameters, n_parameters), infinite on the diagonal where undetermined; notes.
    """
    dead = unseen(jacobian, unit)
    jacobian = np.where(dead, 0.0, jacobian)
    fisher = jacobian.T @ jacobian
    scale = np.where(dead, 1.0, np.sqrt(np.diag(fisher)))
    eigenvalues, vectors = np.linalg.eigh(fisher / np.outer(scale, scale))
    blind = eigenvalues < BLIND
    seen = vectors[:, ~blind] / np.sqrt(eigenvalues[~blind])
    found = (seen @ seen.T) / np.outer(scale, scale)
    notes = []
    lost = np.zeros(len(names), bool)
    for vector in vectors[:, blind].T:
        part = np.abs(vector) > 1e-3
        lost |= part
        named = [name for name, taken in zip(names, part, strict=True) if taken]
        notes.append(
            "these data do not determine "
            f"{named[0] if len(named) == 1 else ' and '.join(named) + ' apart'}"
        )
    found[lost, :] = found[:, lost] = 0.0
    found[lost, lost] = np.inf
    return found, tuple(notes)


def derived(
    derive: Callable[[Complex], Mapping[str, tuple[complex, str]]], values: Array, found: Array
) -> dict[str, Parameter]:
    """Return what follows from fitted parameters, with standard deviations to first order.

    Infinite where an undetermined parameter enters.

    Args:
        derive: parameters (k,), complex for derivatives, → name → (value, unit).
        values: the fitted parameters (k,).
        found: their covariance (k, k), from `covariance`.
    """
    gradients = [derive(values + 1j * STEP * direction) for direction in np.eye(len(values))]
    known = np.isfinite(np.diag(found))
    result = {}
    for name, (value, unit) in derive(values.astype(complex)).items():
        gradient = np.array([complex(g[name][0]).imag for g in gradients]) / STEP
        variance = (
            np.inf
            if np.any(gradient[~known])
            else gradient @ np.where(np.isfinite(found), found, 0.0) @ gradient
        )
        result[name] = Parameter(name, float(complex(value).real), float(np.sqrt(variance)), unit)
    return result


def strongest_correlation(found: Array, names: Sequence[str]) -> str:
    """Return a sentence on the most correlated pair of determined parameters.

    Empty with fewer than two.
    """
    known = np.flatnonzero(np.isfinite(np.diag(found)) & (np.diag(found) > 0))
    if known.size < 2:
        return ""
    sd = np.sqrt(np.diag(found)[known])
    rows, columns = np.triu_indices(known.size, k=1)
    correlation = (found[np.ix_(known, known)] / np.outer(sd, sd))[rows, columns]
    most = int(np.argmax(np.abs(correlation)))
    i, j = known[rows[most]], known[columns[most]]
    return f"the most correlated pair is {names[i]} and {names[j]}, {correlation[most]:+.3f}"
