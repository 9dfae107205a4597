"""What a layout holds: closed curves by role, and what is wrong with it."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import ParameterError, suggest
from femnl.core.outline import Outline, Segment
from femnl.device.geometry.naming import place
from femnl.device.geometry.placing import placed

Array = NDArray[np.float64]
Loop = tuple[Segment, ...]

ROLES = {
    "film": "where the film is",
    "release": "where the wafer under it is gone; the film is clamped at its edge",
    "frame": "where the wafer is left; the film is clamped at its edge",
    "holes": "where the film is etched away",
    "posts": "where the film is held from below; clamped at the rims",
    "metal": "where a layer lies on the film",
}
"""What a layer of a layout may be."""


@dataclass(frozen=True, eq=False)
class Placed:
    """A closed curve drawn about a point `at` (2,) [m]. Like ones share their loop."""

    loop: Loop
    at: Array
    clamped: bool = True

    @property
    def there(self) -> Loop:
        """The loop in its place, clamped or free as a whole."""
        return tuple(replace(s, clamped=self.clamped) for s in moved(self.loop, self.at))


def moved(loop: Loop, by: Array) -> Loop:
    """Return a loop moved by (2,) [m]."""
    return placed(Outline("", loop, None, 0.0), by).segments


@dataclass(frozen=True)
class Fault:
    """Something wrong at a point (2,) [m] of a layout; `fatal` where it cannot be used."""

    what: str
    point: tuple[float, float]
    fatal: bool

    def __str__(self) -> str:
        """One line with the coordinate."""
        return f"{self.what} at {place(np.array(self.point))}"


@dataclass(frozen=True)
class Drawing:
    """A layout as drawn, in m.

    polygons: by role, corners (n, 2) of closed polygons whose arcs are drawn as chords. loops: by
    role, closed curves that the file holds as such. grid: step of the coordinates, 0 where there
    is none. faults: what the reader saw.
    """

    cell: str
    grid: float
    polygons: Mapping[str, Sequence[Array]]
    loops: Mapping[str, Sequence[Loop]] = field(default_factory=dict)
    faults: tuple[Fault, ...] = ()


def read_pairs(
    option: str, text: str, known: Collection[str], form: tuple[str, str]
) -> dict[str, str]:
    """Return the values by key of a text such as "film=1/0,holes=2/0".

    Args:
        option: of the command, which is named where the text is refused.
        text: of pairs with commas between them.
        known: keys that there are.
        form: of one pair, and an example.

    Raises:
        ParameterError: an unknown key, one given twice, or no value.
    """
    found: dict[str, str] = {}
    for entry in text.split(","):
        key, equals, value = (word.strip() for word in entry.partition("="))
        if not equals or not value:
            raise ParameterError(f'{option} "{entry}": expected {form[0]}, write e.g. {form[1]}')
        if key not in known:
            raise ParameterError(f"{option} {key}: {suggest(key, list(known))}")
        if key in found:
            raise ParameterError(f"{option} {key} stands twice; leave one of them out")
        found[key] = value
    return found


def read_layers(text: str) -> dict[str, str]:
    """Return the layer by role of a text such as "film=1/0,holes=2/0".

    Raises:
        ParameterError: an unknown role, one given twice, or no film.
    """
    found = read_pairs("--layers", text, ROLES, ("role=layer", "film=1/0,holes=2/0"))
    if "film" not in found:
        raise ParameterError("--layers names no film; write e.g. film=1/0,holes=2/0")
    return found
