"""What is read off for measured modes, with what effects make of it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from femnl.core.effect import Effect, Values
from femnl.core.readout import Array
from femnl.core.stages import Lines
from femnl.observe.model import apply
from femnl.observe.spectrum.films import Films
from femnl.observe.spectrum.matching import Index


@dataclass(frozen=True, eq=False)
class LineReader:
    """Reads lines off changed films.

    time (n,) [s] of each measured mode, empty where not known; order (n,): its mode of the
    unchanged film; participation (3, n_modes) of those, see `Lines`; gap [m] below the film;
    pressure [Pa] of the gas.
    """

    time: Array
    order: Index
    participation: Array
    gap: float
    pressure: float

    def read_off(
        self,
        films: Films,
        effects: Sequence[Effect],
        numbers: Sequence[Values],
        measured: Index,
        changed: Index,
    ) -> tuple[Array, Array]:
        """Return frequency (m, k) [Hz] and loss (m, k) of measured modes (k,) of m films.

        The loss is (m, 0) where none was measured.

        Args: numbers: parameters of each effect, beside lines (k,) of one film, (m, k) of m films.
            changed (m, k): the changed mode that each is in each film.
        """
        frequency, loss = films.read_off(changed)
        if not any("frequencies" in effect.changes for effect in effects):
            return frequency, loss
        count = len(changed)
        if films.content.size:
            participation = films.participation(changed, self.participation)
        else:
            # Without labels and losses no vectors are solved for; the film's own modes stand for
            # them.
            unmixed = self.participation[:, None, self.order[measured]]
            participation = np.repeat(unmixed, count, axis=1)
        shape = changed.shape if count > 1 else changed.shape[1:]
        lines = Lines(
            frequency.reshape(shape),
            self.time[measured] if len(self.time) else self.time,
            loss.reshape(shape) if loss.size else np.empty(0),
            participation.reshape(3, *shape),
            films.film,
            self.gap,
            self.pressure,
        )
        lines = apply("frequencies", lines, effects, numbers)
        return lines.frequency.reshape(count, -1), lines.loss.reshape(count, -1)
