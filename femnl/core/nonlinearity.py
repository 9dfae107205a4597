"""Geometric nonlinearity of modes: stiffnesses k₃ and Duffing coefficients α with their errors."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from femnl.core.arrays import freeze
from femnl.core.discretisation_error import ERRORS, NO_ERRORS
from femnl.core.numbers import with_error
from femnl.core.tables import Table, Tabulated, dataframe, dataset

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Nonlinearity(Tabulated):
    """Geometric cubic coefficients in the coordinate q of the point where |ξ| = 1.

    q is its displacement [m].

    k3 [N/m³] and alpha = k3/k [m⁻²] of each mode, so that m q̈ = −k q − k₃ q³. k3_error,
    alpha_error: discretisation errors, upper estimates, infinite where the modes carry no
    counterpart of lower degree. tensor (n, n, n, n) [N/m³], where asked for: the force on mode i is
    −Σ tensor[i,j,k,l] q_j q_k q_l; fully symmetric. tensor_error, of each of its entries. first:
    number of the first of these modes, see `Modes`.
    """

    edge: str
    k3: Array
    alpha: Array
    k3_error: Array
    alpha_error: Array
    tensor: Array | None = None
    tensor_error: Array | None = None
    first: int = 1

    def __post_init__(self) -> None:
        freeze(self)

    def __repr__(self) -> str:
        """Number of modes, in-plane edge, and α of the first."""
        return (
            f"<Nonlinearity of {len(self.k3)} modes, in-plane edge {self.edge}, "
            f"α = {self.alpha[0]:.7g} m⁻² of the first>"
        )

    def to_dataset(self) -> "xr.Dataset":
        """Return k₃ and α with errors, and the tensor where there is one.

        Returns: Dataset over `mode` (from 1), SI units as attributes; `tensor` over the dimensions
            i, j, k, l.
        """
        found = self._columns()
        tensors = {"tensor": self.tensor, "tensor_error": self.tensor_error}
        for name, values in tensors.items():
            if values is not None:
                found[name] = (tuple("ijkl"), values, {"units": "N/m³"})
        return found

    def to_dataframe(self) -> "pd.DataFrame":
        """Return a row a mode (from 1), in SI; `attrs["units"]` holds the units by column."""
        return dataframe(self._columns())

    def _columns(self) -> "xr.Dataset":
        found = dataset(
            "mode",
            {"mode": (self.first + np.arange(len(self.k3)), "")},
            {
                "k3": (self.k3, "N/m³"),
                "k3_error": (self.k3_error, "N/m³"),
                "alpha": (self.alpha, "m⁻²"),
                "alpha_error": (self.alpha_error, "m⁻²"),
            },
        )
        return found.assign_attrs(edge=self.edge)

    def _tables(self) -> list[Table]:
        per_micrometre = zip(self.alpha * 1e-12, self.alpha_error * 1e-12, strict=True)
        columns = {
            "mode": [str(self.first + k) for k in range(len(self.k3))],
            "k₃ (N/m³)": [with_error(*k) for k in zip(self.k3, self.k3_error, strict=True)],
            "α (µm⁻²)": [with_error(*a) for a in per_micrometre],
        }
        notes = [ERRORS if np.isfinite(self.k3_error).all() else NO_ERRORS]
        if self.tensor is not None:
            notes.append("the full cubic tensor [N/m³] is in `tensor`")
        return [Table(f"Duffing coefficients, in-plane edge {self.edge}", columns, notes)]
