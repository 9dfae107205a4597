"""The laws of a series: values, slopes, and a start by linear least squares."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.core.choices import Law
from femnl.core.errors import ParameterError
from femnl.core.readout import Array

BOLTZMANN = 1.380649e-23
"""Boltzmann constant [J/K], exact in the SI."""
QUANTITIES: Mapping[str, str] = {"frequency": "Hz", "quality_factor": ""}
"""What a series holds, with its unit."""
PARAMETERS: Mapping[Law, tuple[str, str]] = {
    "line": ("value", "slope"),
    "power": ("value", "exponent"),
    "arrhenius": ("prefactor", "activation_energy"),
}
"""Parameters of each law."""


def units_of(law: Law, unit: str, per: str) -> tuple[str, str]:
    """Return the units of the two parameters of a law."""
    return unit, {"line": _per(unit, per), "power": "", "arrhenius": "J"}[law]


@dataclass(frozen=True)
class Form:
    """A law: its values (n,) and their slopes (n, k) by its parameters.

    names, units and start of the parameters; steps (k,): a change of each that would matter, by
    which `covariance` tells what the data do not see.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    start: Array
    steps: Array
    predict: Callable[[Array], Array]
    slopes: Callable[[Array], Array]
    notes: tuple[str, ...]


def form_of(law: Law, key: str, against: tuple[str, str], x: Array, y: Array, sd: Array) -> Form:
    """Return the law with a start from linear least squares.

    Args: against: the control variable and its unit.
    """
    control, per = against
    weight = (sd.min() / sd) ** 2
    unit = QUANTITIES[key]
    place = f"value is that at {control.replace('_', ' ')} ="
    if law == "line":
        middle = float(np.sum(weight * x) / np.sum(weight))
        columns = np.column_stack([np.ones(len(x)), x - middle])
        return Form(
            PARAMETERS[law],
            units_of(law, unit, per),
            _linear(columns, y, sd),
            float(np.max(np.abs(y))) * np.array([1, 1 / float(np.ptp(x))]),
            lambda p: np.asarray(columns @ p),
            lambda p: columns,
            (f"{place} {middle:.6g} {per}".rstrip(),),
        )
    if np.any(x <= 0) or np.any(y <= 0):
        raise ParameterError(f"series: the law {law} needs positive values of {control} and {key}")
    if law == "power":
        middle = float(np.exp(np.sum(weight * y**2 * np.log(x)) / np.sum(weight * y**2)))
        ratio = np.log(x / middle)
        return _power(unit, ratio, y, sd, (f"{place} {middle:.6g} {per}".rstrip(),))
    inverse = 1 / (BOLTZMANN * x)
    scale = float(inverse.mean())
    logged = _linear(np.column_stack([np.ones(len(x)), -inverse / scale]), np.log(y), sd / y)

    def predict(p: Array) -> Array:
        return np.asarray(p[0] * np.exp(-p[1] * inverse))

    def slopes(p: Array) -> Array:
        factor = np.exp(-p[1] * inverse)
        return np.column_stack([factor, -p[0] * inverse * factor])

    start = np.array([np.exp(logged[0]), logged[1] / scale])
    steps = np.array([start[0], 1 / scale])
    return Form(PARAMETERS[law], (unit, "J"), start, steps, predict, slopes, ())


def _per(unit: str, per: str) -> str:
    """Return the unit of a slope: Hz/K, Hz/(V/m), 1/K, and Hz against a plain number."""
    if not per:
        return unit
    return f"{unit or '1'}/{per if per.isalpha() else f'({per})'}"


def _power(unit: str, ratio: Array, y: Array, sd: Array, notes: tuple[str, ...]) -> Form:
    """Return the power law, ratio (n,) = ln(x/x̄)."""
    logged = _linear(np.column_stack([np.ones(len(y)), ratio]), np.log(y), sd / y)

    def predict(p: Array) -> Array:
        return np.asarray(p[0] * np.exp(p[1] * ratio))

    def slopes(p: Array) -> Array:
        factor = np.exp(p[1] * ratio)
        return np.column_stack([factor, p[0] * ratio * factor])

    start = np.array([np.exp(logged[0]), logged[1]])
    steps = np.array([start[0], 1.0])
    return Form(PARAMETERS["power"], (unit, ""), start, steps, predict, slopes, notes)


def _linear(columns: Array, y: Array, sd: Array) -> NDArray[np.float64]:
    found = np.linalg.lstsq(columns / sd[:, None], y / sd, rcond=None)[0]
    return np.asarray(found)
