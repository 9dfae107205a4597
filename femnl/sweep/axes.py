"""The axes of a sweep: values of a geometry file that vary together, as lists or ranges."""

import json
import re
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from femnl.core.errors import ParameterError
from femnl.device.geometry.schema import GeometryFile
from femnl.device.geometry.tables import complaint, show

Tables = dict[str, Any]

_QUANTITY = re.compile(
    r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)\s*(\D.*?)?\s*", re.ASCII
)
_DIGITS = 12  # of written values: as many as any computer agrees on
KIND = "kind"
"""Key of a table that says which other keys it has."""
_SPACINGS = ("linear", "log")


@dataclass(frozen=True)
class Range:
    """Values from `low` to `high` in one unit ("" for plain numbers).

    Evenly spaced or, where `log`, in even ratios.

    points: how many; None where a sample says how many.
    """

    low: float
    high: float
    unit: str
    points: int | None
    log: bool

    def within(self, place: float) -> Any:
        """Return the value at a place from 0 to 1, as a geometry file writes it."""
        value = (
            self.low * (self.high / self.low) ** place
            if self.log
            else self.low + place * (self.high - self.low)
        )
        text = f"{value:.{_DIGITS}g}"
        if self.unit:
            return f"{text} {self.unit}"
        return int(float(text)) if float(text).is_integer() else float(text)


@dataclass(frozen=True)
class Axis:
    """Paths into the geometry, such as "holes.radius", whose values vary together."""

    values: dict[str, Range | list[Any]]

    @property
    def points(self) -> int:
        """How many points the axis has; 0 where a sample says how many."""
        first = next(iter(self.values.values()))
        return (first.points or 0) if isinstance(first, Range) else len(first)

    def at(self, index: int) -> dict[str, Any]:
        """Return the values at one of the points."""
        place = index / max(self.points - 1, 1)
        return {
            path: values.within(place) if isinstance(values, Range) else values[index]
            for path, values in self.values.items()
        }

    def within(self, place: float) -> dict[str, Any]:
        """Return the values at a place of the ranges from 0 to 1."""
        return {
            path: values.within(place)
            for path, values in self.values.items()
            if isinstance(values, Range)
        }


def read_axis(table: dict[str, Any]) -> Axis:
    """Read one [[axis]] of a sweep file.

    Holes.radius = ["0.5 um", "1 um"], or = {from = "0.5 um", to = "2 um", points = 4}.

    Raises: ParameterError.
    """
    values: dict[str, Range | list[Any]] = {}

    def walk(part: dict[str, Any], before: str) -> None:
        for key, value in part.items():
            path = before + key
            if isinstance(value, dict) and not {"from", "to"} & value.keys():
                walk(value, f"{path}.")
            elif isinstance(value, dict):
                values[path] = _range(path, value)
            elif isinstance(value, list) and value:
                values[path] = value
            else:
                raise ParameterError(
                    f"axis {path} = {show(value)}: expected a list of values, or "
                    f"{{from = …, to = …, points = 5}}"
                )

    walk(table, "")
    if not values:
        raise ParameterError(
            'axis: an axis varies something, write e.g. film.stress = ["1 GPa", "1.1 GPa"]'
        )
    axis = Axis(values)
    for path, given in values.items():
        if Axis({path: given}).points != axis.points:
            first = next(iter(values))
            raise ParameterError(
                f"axis {path}: {Axis({path: given}).points} values beside {axis.points} of "
                f"{first}, with which it varies; give as many, or an [[axis]] of its own"
            )
    return axis


def check_axis(axis: Axis, base: Tables) -> None:
    """Refuse values that no device can have, whatever the others are.

    a wrong unit, a wrong type, a wrong sign.

    Args: base: tables of the geometry, sound in themselves.
    Raises: ParameterError. What is wrong only in company, such as holes wider than their pitch, is
    left to the point that has it.
    """
    for path in axis.values:
        table, _, key = path.rpartition(".")
        if key == KIND:
            raise ParameterError(
                f"axis {path}: each kind has keys of its own; vary the whole table, write e.g. "
                f'{table} = [{{kind = "square", side = "1 mm"}}, …]'
            )
    ranged = any(isinstance(values, Range) for values in axis.values.values())
    sampled = ranged and axis.points == 0
    ends = (
        [axis.within(0.0), axis.within(1.0)]
        if sampled
        else [axis.at(k) for k in ((0, axis.points - 1) if ranged else range(axis.points))]
    )
    for values in ends:
        try:
            GeometryFile.model_validate(put(base, values))
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            if first["type"] != "geometry" or first["ctx"]["key"] is None:
                raise ParameterError(f"axis {', '.join(axis.values)}: {complaint(error)}") from None


def locate(tables: Tables, path: str) -> tuple[Any, Any]:
    """Return the table of a geometry that holds the value at a path, and its key there.

    Or the list, counted from 1.

    Raises: KeyError where there is none.
    """
    holder: Any = None
    key: Any = None
    here: Any = tables
    for part in path.split("."):
        holder = here
        key = part
        if isinstance(here, list) and part.isdecimal() and 1 <= int(part) <= len(here):
            key = int(part) - 1
        elif not isinstance(here, dict) or part not in here:
            raise KeyError(path)
        here = holder[key]
    return holder, key


def put(tables: Tables, values: dict[str, Any]) -> Tables:
    """Return a copy of a geometry's tables with new values at their paths."""
    copy = json.loads(json.dumps(tables))
    for path, value in values.items():
        holder, key = locate(copy, path)
        holder[key] = value
    return dict(copy)


def _range(path: str, table: dict[str, Any]) -> Range:
    for key in table:
        if key not in ("from", "to", "points", "spacing"):
            raise ParameterError(
                f"axis {path}: {key}: unknown key, a range has from, to, points and spacing"
            )
    for key in ("from", "to"):
        if key not in table:
            raise ParameterError(f"axis {path}: {key} is missing; a range has both ends")
    (low, unit), (high, other) = (
        _number(f"axis {path}: {key}", table[key]) for key in ("from", "to")
    )
    if unit != other:
        raise ParameterError(
            f'axis {path}: from is in "{unit}" and to in "{other}"; write both in one unit'
        )
    points = table.get("points")
    if points is not None and (
        isinstance(points, bool) or not isinstance(points, int) or points < 1
    ):
        raise ParameterError(
            f"axis {path}: points = {show(points)}: expected a whole number from 1"
        )
    spacing = table.get("spacing", "linear")
    if spacing not in _SPACINGS:
        raise ParameterError(
            f"axis {path}: spacing = {show(spacing)}: expected one of {', '.join(_SPACINGS)}"
        )
    if spacing == "log" and (low <= 0 or high <= 0):
        raise ParameterError(
            f'axis {path}: even ratios need two positive ends; take spacing = "linear"'
        )
    return Range(low, high, unit, points, spacing == "log")


def _number(where: str, value: Any) -> tuple[float, str]:
    """The number and the unit of a written value."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value), ""
    match = _QUANTITY.fullmatch(value) if isinstance(value, str) and len(value) < 80 else None
    if match is None:
        raise ParameterError(
            f'{where} = {show(value)}: expected a number, or one with its unit such as "0.9 um"'
        )
    return float(match[1]), match[2] or ""
