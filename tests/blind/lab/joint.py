"""Several measurements of one device in one file.

Maps under two lasers, and a spectrum with sweeps.

What belongs to the film and its motion is in all of them; a file's detector has the same faults
under both lasers.
"""

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np
import xarray as xr

from tests.blind.lab import maps, response, spectrum
from tests.blind.lab.bench import Array, Bench, Cause, Noise, Values
from tests.blind.lab.maps import MapBench

Draw = Callable[[np.random.Generator, "JointBench"], Cause]
LASERS = {"red": 632.8e-9, "green": 532e-9}
POINTS = 25


class JointBench:
    """Benches side by side, see `Bench`.

    Base parameters are named "measurement.parameter", except those that the benches share.
    """

    def __init__(
        self,
        parts: Mapping[str, Bench],
        shared: tuple[str, ...],
        acting: Callable[[str], tuple[str, ...]],
    ) -> None:
        self.parts = dict(parts)
        self.shared = shared
        self.acting = acting
        self.unit = {
            self._named(group, spec): unit
            for group, part in self.parts.items()
            for spec, unit in part.unit.items()
        }

    def _named(self, group: str, spec: str) -> str:
        return spec if spec in self.shared else f"{group}.{spec}"

    def _own(
        self, group: str, base: Values, hidden: dict[str, Values]
    ) -> tuple[Values, dict[str, Values]]:
        own = {spec: base[self._named(group, spec)] for spec in self.parameters[group]}
        return own, {name: values for name, values in hidden.items() if name in self.acting(group)}

    def draw(self, rng: np.random.Generator) -> Values:
        """Draw the base parameters of each; what they share is that of the last."""
        drawn = {group: part.draw(rng) for group, part in self.parts.items()}
        self.parameters = {group: tuple(own) for group, own in drawn.items()}
        return {
            self._named(group, spec): value
            for group, own in drawn.items()
            for spec, value in own.items()
        }

    def clean(self, variants: list[tuple[Values, dict[str, Values]]]) -> Array:
        """Data of all over their σ, one after the other."""
        return np.concatenate(
            [
                part.clean([self._own(group, *one) for one in variants])
                for group, part in self.parts.items()
            ],
            axis=1,
        )

    def measured(
        self, base: Values, hidden: dict[str, Values], rng: Noise
    ) -> dict[str, xr.Dataset]:
        """The groups of all."""
        found = {}
        for group, part in self.parts.items():
            (found[group],) = part.measured(*self._own(group, base, hidden), rng).values()
        return found


def _beside(kind: str, draw: Callable[[np.random.Generator, Any], Cause]) -> Draw:
    """Draw a cause for the measurement of that kind."""
    return lambda rng, bench: draw(rng, bench.parts[kind])


class Lasers:
    """Maps of one motion under two lasers."""

    CAUSES: ClassVar[dict[str, Draw]] = {
        name: _beside("red", draw) for name, draw in maps.CAUSES.items()
    }

    @staticmethod
    def setup(name: str, causes: tuple[str, ...], rng: np.random.Generator) -> JointBench:
        """Prepare the maps."""
        parts = {
            laser: MapBench(name, causes, rng, POINTS, wavelength)
            for laser, wavelength in LASERS.items()
        }
        for part in parts.values():
            part.drive = parts["red"].drive
        return JointBench(parts, ("amplitude",), lambda group: tuple(maps.CAUSES))


_KINDS: dict[str, Any] = {"spectrum": spectrum, "response": response}


class Device:
    """A spectrum of a film and sweeps of one of its modes."""

    CAUSES: ClassVar[dict[str, Draw]] = {
        name: _beside(kind, draw)
        for kind, part in _KINDS.items()
        for name, draw in part.CAUSES.items()
    }

    @staticmethod
    def setup(name: str, causes: tuple[str, ...], rng: np.random.Generator) -> JointBench:
        """Prepare both."""
        parts: dict[str, Bench] = {
            kind: module.setup(name, causes, rng) for kind, module in _KINDS.items()
        }
        return JointBench(parts, (), lambda group: tuple(_KINDS[group].CAUSES))
