"""A least-squares problem of many residuals as one of hardly more than its parameters."""

from collections.abc import Callable

import numpy as np

from femnl.core.portions import PORTION, portions
from femnl.core.readout import Array

ROUNDING = 1e-14
"""Relative excess by which a place where χ² did not fall is shown as no better."""


class Triangle:
    """The triangle R of [J r] = QR, with slopes J (n, p) and residuals r (n,), for an optimiser.

    R has the squares, the gradient and the curvature of [J r] in p + 1 rows. With a hundred
    thousand rows an optimiser spends most of the time on its own algebra.

    R is that of the place of least χ² so far: there an optimiser that only goes downhill takes the
    slopes, too. Elsewhere χ² alone counts.
    """

    def __init__(self, residuals: Callable[[Array], Array], slopes: Callable[[Array], Array]):
        """Take r and J as functions of the parameters (p,)."""
        self._residuals = residuals
        self._slopes = slopes
        self._place = b""
        self._least = np.inf
        self._triangle = np.empty((0, 1))

    def residuals(self, vector: Array) -> Array:
        """Return the last column of R, or another one whose squares add up to χ²."""
        if vector.tobytes() == self._place:
            return self._triangle[:, -1]
        whole = self._residuals(vector)
        chi2 = float(whole @ whole)
        if chi2 < self._least:
            self._triangle = _triangle(self._slopes(vector), whole)
            self._place = vector.tobytes()
            self._least = chi2
            return self._triangle[:, -1]
        shown = np.zeros(min(len(whole), vector.size + 1))
        least = float(np.linalg.norm(self._triangle[:, -1])) * (1 + ROUNDING)
        shown[0] = max(np.sqrt(chi2), least)
        return shown

    def slopes(self, vector: Array) -> Array:
        """Return the other columns of R, whatever the place: an optimiser asks at that of R."""
        return self._triangle[:, :-1]


def _triangle(slopes: Array, residuals: Array) -> Array:
    """Return the triangle R of [J r] = QR.

    Of portions that stay in the processor's cache, and then of their triangles, it is found in
    two fifths of the time.
    """
    if len(residuals) <= PORTION:
        return _of_portion(slopes, residuals)
    found = [_of_portion(slopes[at], residuals[at]) for at in portions(len(residuals))]
    return np.asarray(np.linalg.qr(np.concatenate(found), mode="r"))


def _of_portion(slopes: Array, residuals: Array) -> Array:
    # Stacked in columns that lie side by side, as a decomposition reads them
    both = np.vstack([slopes.T, residuals]).T
    return np.asarray(np.linalg.qr(both, mode="r"))
