"""Parameters that a fit holds at given values, and the free rest."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import ParameterError
from femnl.core.fit import Parameter
from femnl.core.readout import Array
from femnl.fits.covariance import covariance


@dataclass(frozen=True, eq=False)
class Held:
    """Which of the parameters (k,) a fit holds, and at what values.

    names: of all parameters; values (k,): those held in the unit of the fit, NaN where free.
    """

    names: tuple[str, ...]
    values: Array

    @property
    def free(self) -> NDArray[np.bool_]:
        """Which parameters (k,) the fit may change."""
        return np.isnan(self.values)

    @property
    def _free_names(self) -> list[str]:
        return [name for name, moves in zip(self.names, self.free, strict=True) if moves]

    def put(self, whole: Array) -> Array:
        """Return parameters (k,) with the held ones at their values."""
        return np.where(self.free, whole, self.values)

    def whole(self, free: Array) -> Array:
        """Return all parameters (k,) from the free ones."""
        found = self.values.copy()
        found[self.free] = free
        return found

    def of_free(
        self, residuals: Callable[[Array], Array], jacobian: Callable[[Array], Array]
    ) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
        """Return residuals and their jacobian as functions of the free parameters alone."""

        def free_residuals(free: Array) -> Array:
            return residuals(self.whole(free))

        def free_jacobian(free: Array) -> Array:
            return np.asarray(jacobian(self.whole(free))[:, self.free])

        return free_residuals, free_jacobian

    def covariance(self, jacobian: Array, unit: Array) -> tuple[Array, tuple[str, ...]]:
        """Return the covariance (k, k) of the free parameters, 0 for held ones, and notes.

        Args: jacobian (n_points, k), unit (k,): those of `femnl.fits.covariance.covariance`, of all
            parameters.
        """
        free = self.free
        inner, notes = covariance(jacobian[:, free], self._free_names, unit[free])
        found = np.zeros((len(free), len(free)))
        found[np.ix_(free, free)] = inner
        return found, notes

    def inner(self, whole: Array) -> Array:
        """Return the covariance of the free parameters alone, from that of all (k, k)."""
        return whole[np.ix_(self.free, self.free)]

    @property
    def notes(self) -> tuple[str, ...]:
        """What is held, in a sentence."""
        own = [name for name, moves in zip(self.names, self.free, strict=True) if not moves]
        return (said(own),) if own else ()

    def ordered(self, parameters: Mapping[str, Parameter]) -> dict[str, Parameter]:
        """Return the parameters with the free ones first, as `Fit` has them."""
        first = {name: parameters[name] for name in self._free_names if name in parameters}
        return first | dict(parameters)


def hold_fixed(names: Sequence[str], fixed: Mapping[str, float] | None, what: str) -> Held:
    """Return which parameters are held.

    Args: names: of all parameters of the fit; fixed: values by name; what: the fit is called in
    messages, such as "a ring-down".
    Raises: ParameterError for a name that the fit does not have, a value that is not finite, and
    where nothing is left to fit.
    """
    values = np.full(len(names), np.nan)
    for name, value in (fixed or {}).items():
        if name not in names:
            raise ParameterError(unknown(name, names, what))
        if not np.isfinite(value):
            raise ParameterError(f"fixed: {name} = {value}: give a finite number, in SI")
        values[list(names).index(name)] = value
    if not np.isnan(values).any():
        raise ParameterError(
            f"fixed: {', '.join(names)}: nothing of {what} is left to fit; leave one free"
        )
    return Held(tuple(names), values)


def said(names: Sequence[str]) -> str:
    """Return the sentence that names what was held."""
    return f"held at a given value, and so without standard deviation: {', '.join(names)}"


def unknown(name: str, names: Sequence[str], what: str) -> str:
    """Return the message for a name that a fit does not have."""
    return f"fixed: {name[:40]!r} is no parameter of {what}; it has {', '.join(names)}"
