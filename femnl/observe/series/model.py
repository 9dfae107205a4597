"""Frequency and quality factor against a control variable; the base model is constant."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.core.comparison import Comparison, Curve, Curves
from femnl.core.device import Film
from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.numbers import engineering, plain, signed
from femnl.core.readout import Array
from femnl.core.stages import Points
from femnl.observe.model import MeasurementModel, Named, apply
from femnl.observe.residuals import Layout, Quantity

BLOCKS = 4
"""Stretches of neighbouring points that are held out one by one."""
RANDOM = 0.5
"""Correlation of neighbouring ranks up to which an order is random: of 15 points chance makes more
in one of 24 orders."""


def _follows_itself(control: Array) -> bool:
    """Whether a control variable tells its next value, as a ramp and a square wave do.

    One that is not known everywhere may.
    """
    if not np.isfinite(control).all():
        return True
    rank = np.argsort(np.argsort(control, kind="stable"), kind="stable")
    away = rank - rank.mean()
    return bool(abs(np.sum(away[1:] * away[:-1])) > RANDOM * np.sum(away**2))


@dataclass(frozen=True, eq=False)
class SeriesModel(MeasurementModel):
    """Residuals of frequencies and of quality factors.

    film: that of the geometry, with the gap [m] below it. control: values (n,) of each control
    variable, SI, those that vary first; units: that of each. data: values and standard deviations
    (n,) of each quantity. used (n_quantities · n,): which of them are finite.
    """

    kind = "series"

    film: Film
    control: dict[str, Array]
    data: dict[str, tuple[Array, Array]]
    used: NDArray[np.bool_]
    base: tuple[ParameterSpec, ...]
    start: Array
    scales: Mapping[str, float]
    notes: tuple[str, ...]
    units: Mapping[str, str]
    gap: float = np.inf

    @property
    def varied(self) -> tuple[str, ...]:
        """The control variables that take more than one value, all of them known."""
        return tuple(
            name
            for name, values in self.control.items()
            if np.isfinite(values).all() and np.ptp(values) > 0
        )

    @property
    def blocks(self) -> NDArray[np.int64]:
        """Stretches of neighbouring points, in the order of the first control variable."""
        first = next(iter(self.control.values()))
        place = np.argsort(np.argsort(first, kind="stable"), kind="stable") * BLOCKS // len(first)
        return np.tile(place, len(self.data))[self.used].astype(np.int64)

    @property
    def sequence(self) -> Layout | None:
        """Neighbours in the order of the file, where that is not the order of what was varied.

        Else what a model misses is alike in neighbours, as correlated noise is, and so few points
        do not tell the two apart. Time goes on by itself: what wanders with it by no more than the
        stated noise is noise.
        """
        moving = [v for name, v in self.control.items() if name != "time" and np.ptp(v) != 0]
        if not moving or any(_follows_itself(values) for values in moving):
            return None
        count = len(self.used) // len(self.data)
        number = np.where(self.used, np.cumsum(self.used) - 1, -1)
        before = np.roll(number, 1)
        before[::count] = -1
        place = np.arange(int(self.used.sum()))
        return Layout(
            np.full((len(place), 1), -1),
            before[self.used],
            place,
            np.full(len(place), -1),
            shuffled=True,
        )

    @property
    def quantity(self) -> tuple[Array, str]:
        """Hz where frequencies were measured, else quality factors."""
        main = "frequency" if "frequency" in self.data else "quality_factor"
        rows = [
            sd if name == main else np.full_like(sd, np.nan) for name, (_, sd) in self.data.items()
        ]
        return np.concatenate(rows)[self.used], "Hz" if main == "frequency" else ""

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """Each quantity where it is finite, by the control variables."""
        found = []
        begin = 0
        for used, (name, (_, sd)) in zip(
            np.split(self.used, len(self.data)), self.data.items(), strict=True
        ):
            axes = {axis: (v[used], self.units[axis]) for axis, v in self.control.items()}
            at = begin + np.arange(int(used.sum()))
            unit = "Hz" if name == "frequency" else ""
            found.append(Quantity(name.replace("_", " "), unit, at, sd[used], axes))
            begin += len(at)
        return tuple(found)

    def locate(self, residual: int) -> str:
        """Name the quantity and the value of the first control variable."""
        at = int(np.flatnonzero(self.used)[residual])
        count = len(self.used) // len(self.data)
        name, axis = next(iter(self.control.items()))
        quantity = list(self.data)[at // count].replace("_", " ")
        value = plain(float(axis[at % count]), 4)
        return f"{quantity} at {name} = {value} {self.units[name]}".rstrip()

    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        """Return (f − f_predicted)/σ, then (Q − Q_predicted)/σ."""
        return self._against(self.control, effects, base, values)[self.used]

    def _against(
        self,
        control: dict[str, Array],
        effects: Sequence[Effect],
        base: Values,
        values: Sequence[Values],
        spot: float = 1.0,
    ) -> Array:
        """Return all residuals at these values of the control variables, finite or not.

        Args: spot: ξ² under the laser, in parts of what it was.
        """
        count = len(next(iter(control.values())))
        flat = {
            name: np.full(count, base.get(name, 1.0)) for name in ("frequency", "quality_factor")
        }
        points = apply(
            "points",
            Points(flat["frequency"], flat["quality_factor"], control, self.film, self.gap, spot),
            effects,
            values,
        )
        return np.concatenate(
            [(data - getattr(points, name)) / sd for name, (data, sd) in self.data.items()]
        )

    def residual_directions(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return a slope and a bend of each quantity against each control variable."""
        found = {}
        sizes = [len(data) for data, _ in self.data.values()]
        for control in self.varied:
            axis = self.control[control]
            unit = 2 * (axis - axis.min()) / np.ptp(axis) - 1
            for k, (name, (_, sd)) in enumerate(self.data.items()):
                for power, word in ((1, "slope"), (2, "bend")):
                    rows = [np.zeros(n) for n in sizes]
                    rows[k] = unit**power / sd
                    found[f"{word} of {name} with {control}"] = np.concatenate(rows)[self.used]
        return found

    def candidate_measurements(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return what each control variable would show, varied over its range with the others held.

        This separates causes that moved together. A laser on a nodal line heats the film, but
        exerts no force on the mode.
        """
        found = {}
        for name in self.control:
            held = {
                other: v if other == name else np.full_like(v, v.mean())
                for other, v in self.control.items()
            }
            found[f"the same series with only {name} varied"] = -np.nan_to_num(
                self._against(held, effects, base, values)
            )
        if "laser_power" in self.scales:
            found["the same series with the laser on a nodal line of the mode"] = -np.nan_to_num(
                self._against(self.control, effects, base, values, spot=0.0)
            )
        return found

    def compare(self, models: Sequence[Named]) -> tuple[Comparison, ...]:
        """Return each quantity against each control variable that was varied."""
        count = len(self.used) // len(self.data)
        names = tuple(name for name, *_ in models)
        away = np.full((len(models), len(self.used)), np.nan)
        away[:, self.used] = [
            self.residuals(effects, base, values) for _, effects, base, values in models
        ]
        found = []
        for control in self.varied:
            axis = self.control[control]
            order = np.argsort(axis)
            for k, (name, (data, sd)) in enumerate(self.data.items()):
                predicted = data - away[:, k * count : (k + 1) * count] * sd
                curve = Curve(name, axis[order], data[order], sd[order], predicted[:, order])
                unit = "Hz" if name == "frequency" else ""
                found.append(
                    Curves(
                        "series",
                        control.replace("_", " "),
                        self.units[control],
                        name.replace("_", " "),
                        unit,
                        names,
                        (curve,),
                    )
                )
        return tuple(found)

    def describe(self, residuals: Array) -> str:
        """Say which quantity moves, between which values of the control variable."""
        whole = np.full(len(self.used), np.nan)
        whole[self.used] = residuals
        control, axis = next(iter(self.control.items()))
        rows = dict(zip(self.data, np.split(whole, len(self.data)), strict=True))
        worst = max(rows, key=lambda name: np.nanmean(rows[name] ** 2))
        order = np.argsort(axis)
        order = order[np.isfinite(rows[worst][order])]
        ends = rows[worst][order[0]], rows[worst][order[-1]]
        low, high = (engineering(float(axis[at]), self.units[control]) for at in order[[0, -1]])
        first, last = (signed(float(end), "") for end in ends)
        rms = plain(float(np.sqrt(np.nanmean(rows[worst] ** 2))), 3)
        return (
            f"{worst} is not constant: from {first}σ at {control} = {low} to {last}σ at {high}; "
            f"rms {rms}σ"
        )
