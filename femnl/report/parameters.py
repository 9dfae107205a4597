"""Parameters of a diagnosis for its page: in readable units, and how they are correlated."""

from dataclasses import dataclass

import numpy as np

from femnl.core.diagnosis import Bound, Covariance, Diagnosis
from femnl.core.fit import Parameter
from femnl.core.numbers import Scale, plain, scale_for, with_error

WIDE = 99.5
"""Error from which on two of its digits end before the decimal point."""
MOST = 12
"""Parameters of a table of correlations: more do not fit a page."""


def parameter_rows(diagnosis: Diagnosis) -> list[list[str]]:
    """Return the owner, name, value before and after, what equations may add to its error, unit.

    Where no cause is named, the owner, name, value and unit. The base parameters come first, also
    those that a cause replaces.
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
    return [[owner, name, value, unit] for owner, name, _, value, _, unit in rows]


def bound_rows(bounds: tuple[Bound, ...]) -> list[list[str]]:
    """Return the cause, names, the range of parameters in a readable unit, and why.

    Parameters of one range and one reason share a row.
    """
    names: dict[tuple[str, ...], list[str]] = {}
    for b in bounds:
        scale = scale_for(max(abs(b.low), abs(b.high)), b.unit)
        low, high = (plain(value / scale.size, 3) for value in (b.low, b.high))
        names.setdefault((b.cause, low, high, scale.unit, b.reason), []).append(b.name)
    return [[cause, ", ".join(own), *rest] for (cause, *rest), own in names.items()]


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

    Of many parameters, those most strongly correlated with the causes are returned. The result is
    None for fewer than two.
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
    # Nothing that rounds to zero has a sign
    shown = f"{round(rho, 2) + 0.0:.2f}".replace("-", "−")
    return shown, abs(rho), "negative" if rho < 0 else "positive"


def _row(owner: str, name: str, before: Parameter | None, after: Parameter | None) -> list[str]:
    scale = _scale([parameter for parameter in (after, before) if parameter is not None])
    told = [_value(before, scale), _value(after, scale), _by_equations(after, scale)]
    return [owner, name, *told, scale.unit]


def _scale(parameters: list[Parameter]) -> Scale:
    """Return the unit of the first value.

    The next larger one where an error to two digits would need a power of ten.
    """
    first = parameters[0]
    scale = scale_for(max(abs(first.value), _error(first)), first.unit)
    if max(map(_error, parameters)) / scale.size < WIDE:
        return scale
    return scale_for(1000 * scale.size, first.unit)


def _error(parameter: Parameter) -> float:
    return parameter.sd if np.isfinite(parameter.sd) else 0.0


def _value(parameter: Parameter | None, scale: Scale) -> str:
    if parameter is None:
        return "–"
    return with_error(parameter.value / scale.size, parameter.sd / scale.size, 2)


def _by_equations(parameter: Parameter | None, scale: Scale) -> str:
    if parameter is None or not np.isfinite(parameter.equation_sd) or parameter.equation_sd == 0:
        return "–"
    return f"± {plain(parameter.equation_sd / scale.size, 2)}"
