"""A chip as its study says: devices, their places, and their numbers."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Number:
    """A number measured several times or once: median, and standard deviation of that.

    repeats: how often.
    """

    value: float
    sd: float
    repeats: int = 1


@dataclass(frozen=True)
class Member:
    """A device of a chip. place [m, or steps of the grid], NaN where it is not known.

    frequency [Hz], quality: by mode.
    """

    name: str
    design: str
    place: tuple[float, float]
    frequency: dict[str, Number] = field(default_factory=dict)
    quality: dict[str, Number] = field(default_factory=dict)


@dataclass(frozen=True)
class Chip:
    """A chip. geometries: of designs, by name. notes: what was assumed. unit: of places."""

    name: str
    members: tuple[Member, ...]
    geometries: dict[str, str]
    notes: tuple[str, ...]
    unit: str = "m"
