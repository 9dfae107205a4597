"""The table [values] of a description: what a file does not hold."""

from femnl.core.errors import MeasurementError, suggest
from femnl.io.labfiles.base import SWEEP_VALUES, Groups
from femnl.io.labfiles.spec import Spec
from femnl.io.measurement import KINDS, quantity

_BESIDE = {
    "response": tuple(SWEEP_VALUES),
    "map": ("harmonic",),
    "trace": ("drive_frequency",),
    "decay": ("notes", "mode"),
}
"""What readers take of [values] beside the attributes of a kind."""


def with_values(groups: Groups, spec: Spec, where: str) -> Groups:
    """Return measurements with what [values] says of each as a whole, where the file says nothing.

    Raises: MeasurementError for a name that no measurement of these kinds has, and for a value that
    is none of the quantity.
    """
    _refuse_unknown(groups, spec, where)
    found = {}
    for key, group in groups.items():
        known = KINDS[str(group.attrs["kind"])].attributes
        missing = {
            name: value
            for name, value in spec.values.items()
            if name in known and name not in group.attrs and not isinstance(value, list)
        }
        own: dict[str, float | str] = {}
        for name, value in missing.items():
            unit = known[name].unit
            own[name] = (
                str(value) if unit is None else quantity(value, unit, f"{where}: values.{name}")[0]
            )
        found[key] = group.assign_attrs(own)
    return found


def _refuse_unknown(groups: Groups, spec: Spec, where: str) -> None:
    kinds = {str(group.attrs["kind"]) for group in groups.values()}
    known = {name for kind in kinds for name in (*KINDS[kind].attributes, *_BESIDE.get(kind, ()))}
    for name in spec.values:
        if name not in known:
            remedy = suggest(name, sorted(known)) if known else "leave it out"
            raise MeasurementError(
                f"{where}: values.{name} is none of a {' or '.join(sorted(kinds))}; {remedy}"
            )
