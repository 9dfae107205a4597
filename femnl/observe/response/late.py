"""Sweeps whose points keep something of those before, in the mode or in the lock-in."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainccinv

from femnl.core.compiled import compiled
from femnl.core.readout import Array, ComplexArray
from femnl.core.stages import Acquisition
from femnl.observe.response.acquisition import low_pass, settle
from femnl.observe.response.sweeps import Sweeps

LATE = 4
"""Points by which a jump may seem late, or early, behind a slow filter."""


@dataclass(frozen=True, eq=False)
class States:
    """Both states of a mode at every point.

    delta δ and bend a (n,), see `settle`; amplitude b and voltage [V] (2, n) at rest on the low and
    on the high branch.
    """

    delta: Array
    bend: ComplexArray
    amplitude: ComplexArray
    voltage: ComplexArray


@dataclass(frozen=True, eq=False)
class LateSweeps:
    """Sweeps in the order of time.

    step (n_points,): time since the point before, in those that most points take.
    """

    sweeps: Sweeps
    step: Array

    def voltage(
        self,
        swept: Acquisition,
        states: States,
        chosen: NDArray[np.int64],
        read_out: Callable[[ComplexArray], ComplexArray],
    ) -> ComplexArray:
        """Return the voltage (n,) as acquired.

        A jump seems late where a filter is slow: it is where the data say, within `LATE` points.

        Args: chosen (n,): the branch of each point, as far as points tell one by one. read_out:
            from motion to voltage.
        """
        late = np.any(swept.filtered) and self._jumps(chosen)
        branches = chosen[self._later] if late else chosen[None]
        # A filter alone follows what the states are read out as
        volts = np.take_along_axis(states.voltage, branches, axis=0)
        if np.any(swept.motion):
            moved = self._motion(swept.motion, states, branches)
            volts = np.stack([read_out(row) for row in moved])
        trials = self._filtered(swept, volts)
        if len(trials) == 1:
            return np.asarray(trials[0])
        misfit = np.abs(trials - self.sweeps.voltage) ** 2
        nearest = np.argmin(np.add.reduceat(misfit, self._starts, axis=1), axis=0)
        points = np.diff(np.append(self._starts, len(chosen)))
        taken = np.repeat(nearest, points)
        return np.asarray(np.take_along_axis(trials, taken[None], axis=0)[0])

    def _jumps(self, chosen: NDArray[np.int64]) -> bool:
        """Whether any sweep goes from one branch (n,) to the other."""
        changed = np.diff(chosen) != 0
        changed[self._starts[1:] - 1] = False
        return bool(changed.any())

    def _motion(
        self, kept: float | Array, states: States, branches: NDArray[np.int64]
    ) -> ComplexArray:
        """Return the motion (m, n) that follows the drive late.

        Args: kept: of a deviation from one point to the next. branches (m, n): states at rest.
        """
        order, begins = self._order
        steady = np.take_along_axis(states.amplitude, branches, axis=0)[:, order]
        rest = (-np.log(kept) * self.step)[order]
        late = np.empty_like(steady)
        for row, at_rest in zip(late, steady, strict=True):
            compiled(settle)(row, at_rest, states.delta[order], states.bend[order], rest, begins)
        found = np.empty_like(late)
        found[:, order] = late
        return found

    def _filtered(self, swept: Acquisition, volts: ComplexArray) -> ComplexArray:
        """Return the voltages (m, n) behind the filter of the lock-in."""
        if not np.any(swept.filtered):
            return volts
        order, begins = self._order
        rest = (_steps_of_filter(swept) * self.step)[order]
        late = np.empty_like(volts)
        compiled(low_pass)(late, volts[:, order], rest, int(swept.poles), begins)
        found = np.empty_like(late)
        found[:, order] = late
        return found

    @cached_property
    def _starts(self) -> NDArray[np.int64]:
        """Where each sweep begins that has points."""
        return np.array([span.start for span in self.sweeps.spans if span.stop > span.start])

    @cached_property
    def _later(self) -> NDArray[np.int64]:
        """Points (2·LATE + 1, n) whose branch each one has where jumps come so many points late."""
        lateness = np.arange(-LATE, LATE + 1)[:, None]
        place = np.arange(len(self.sweeps.frequency))
        found = np.empty((len(lateness), len(place)), np.int64)
        for span, way in zip(self.sweeps.spans, self.sweeps.direction, strict=True):
            found[:, span] = np.clip(place[span] - lateness * int(way), span.start, span.stop - 1)
        return found

    @cached_property
    def _order(self) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """The points (n,) in the order of time, and at which of those a sweep begins."""
        parts = [
            np.arange(span.start, span.stop)[:: -1 if way < 0 else 1]
            for span, way in zip(self.sweeps.spans, self.sweeps.direction, strict=True)
        ]
        begins = np.concatenate([np.arange(len(part)) == 0 for part in parts])
        return np.concatenate(parts), begins


def _steps_of_filter(swept: Acquisition) -> Array:
    """Return u = T/τ, after which a low pass has kept as much of a step, one or (n,).

    Of a step, Q(poles, u) is left. It is slow to invert, and equal for most neighbours: it is
    inverted once for each run of equal numbers.
    """
    kept = np.atleast_1d(swept.filtered)
    begins = np.flatnonzero(np.append(True, np.diff(kept) != 0))
    steps = gammainccinv(swept.poles, kept[begins])
    return np.repeat(steps, np.diff(np.append(begins, len(kept))))
