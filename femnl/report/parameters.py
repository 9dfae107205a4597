"""Parameters of a diagnosis for its page: in readable units, and how they are correlated."""

from dataclasses import dataclass

import numpy as np

from femnl.core.diagnosis import Bound, Covariance, Diagnosis
from femnl.core.fit import Parameter
from femnl.core.numbers import Scale, plain, scale_for, with_error

MOST = 12
"""Parameters of a table of correlations: more do not fit a page."""


def parameter_rows(diagnosis: Diagnosis) -> list[list[str]]:
    """Owner, name, value before and after, unit; one value where no cause is named.

    The base parameters first, also those that a cause replaces.
    """
    before = diagnosis.base_parameters
    after = diagnosis.parameters
    base = after["base"]
    names = [*before, *(name for name in base if name not in before)]
    rows = [_row("base", name, before.get(name), base.get(name)) for name in names]
    for owner, own in after.items():
        if owner != "base":
            rows += [_row(owner, name, None, parameter) for name, parameter in own.items()]
    if diagnosis.causes:
        return rows
    return [[owner, name, value, unit] for owner, name, _, value, unit in rows]


def bound_rows(bounds: tuple[Bound, ...]) -> list[list[str]]:
    """Cause, name, the range of each parameter in a readable unit, and why."""
    rows = []
    for b in bounds:
        scale = scale_for(max(abs(b.low), abs(b.high)), b.unit)
        low, high = (plain(value / scale.size, 3) for value in (b.low, b.high))
        rows.append([b.cause, b.name, low, high, scale.unit, b.reason])
    return rows


@dataclass(frozen=True)
class Correlations:
    """A table of correlations: names, cells by row, and how many parameters are left out.

    A cell is its text, |ρ|, and "positive" or "negative".
    """

    names: list[str]
    rows: list[list[tuple[str, float, str]]]
    left_out: int


def correlations(found: Covariance | None) -> Correlations | None:
    """Return the correlations of the parameters of causes, and of those of the base model.

    Of many, those that are most strongly correlated with the causes; None of less than two.
    """
    if found is None or len(found.names) < 2:
        return None
    rho = found.correlation
    own = np.array([owner != "base" for owner in found.owners])
    of = own if own.any() else ~own
    strongest = np.where(own, np.inf, np.abs(rho[:, of]).max(axis=1))
    kept = np.sort(np.argsort(-strongest, kind="stable")[:MOST])
    listed = list(zip(found.owners, found.names, strict=True))
    names = [name if owner == "base" else f"{owner}.{name}" for owner, name in listed]
    rows = [[_cell(float(rho[i, j])) for j in kept] for i in kept]
    return Correlations([names[k] for k in kept], rows, len(names) - len(kept))


def _cell(rho: float) -> tuple[str, float, str]:
    return f"{rho:.2f}".replace("-", "−"), abs(rho), "negative" if rho < 0 else "positive"


def _row(owner: str, name: str, before: Parameter | None, after: Parameter | None) -> list[str]:
    known = [parameter for parameter in (after, before) if parameter is not None]
    scale = _scale(known[0])
    return [owner, name, _value(before, scale), _value(after, scale), scale.unit]


def _scale(parameter: Parameter) -> Scale:
    """Return the unit of the value, or of its error where that is larger."""
    value = abs(parameter.value)
    error = parameter.sd if np.isfinite(parameter.sd) else 0.0
    return scale_for(max(value, error), parameter.unit)


def _value(parameter: Parameter | None, scale: Scale) -> str:
    if parameter is None:
        return "–"
    return with_error(parameter.value / scale.size, parameter.sd / scale.size, 2)
