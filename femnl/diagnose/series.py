"""Frequency and quality factor against a control variable; the base model is constant."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from femnl.core.comparison import Comparison, Curve, Curves
from femnl.core.effect import Effect, Kind, ParameterSpec, Values
from femnl.core.errors import MeasurementError
from femnl.core.readout import Array
from femnl.core.stages import Points
from femnl.io.measurement import CONTROLS, estimate_noise
from femnl.observe.film import SimulatedFilm
from femnl.observe.model import Named, Ranked, apply

BLOCKS = 4
"""Stretches of neighbouring points that are held out one by one."""


class SeriesModel:
    """Residuals of frequencies and of 1/Q; see `MeasurementModel`."""

    kind: Kind = "series"
    needs_global_search = False
    jumps: tuple[str, ...] = ()
    independent_blocks: tuple[Mapping[str, NDArray[np.bool_]], ...] = ()
    ranked: tuple[Ranked, ...] = ()

    def __init__(self, dataset: xr.Dataset, film: SimulatedFilm) -> None:
        self.film = film.model.film
        self.control = {
            name: np.asarray(dataset[name].values, float)
            for name in CONTROLS
            if name in dataset.coords
        }
        self._data: dict[str, tuple[Array, Array]] = {}
        notes = []
        for name in ("frequency", "quality_factor"):
            if name not in dataset:
                continue
            values = np.asarray(dataset[name].values, float)
            if f"{name}_sd" in dataset:
                sd = np.asarray(dataset[f"{name}_sd"].values, float)
            else:
                kept = dataset[[name]].assign_attrs(kind="series")
                sd = np.full(values.shape, estimate_noise(kept))
                notes.append(
                    f"series: {name}_sd is not in the file; estimated from the scatter as "
                    f"{sd[0]:.3g}"
                )
            self._data[name] = values, sd
        used = [np.isfinite(values) & np.isfinite(sd) for values, sd in self._data.values()]
        self._used = np.concatenate(used)
        if self._used.sum() < 4:
            raise MeasurementError(
                f"series: {self._used.sum()} usable points; a diagnosis needs at least 4"
            )
        middle = {name: float(np.nanmedian(values)) for name, (values, _) in self._data.items()}
        self.base = tuple(
            ParameterSpec(name, unit, 0.5 * middle[name], 2 * middle[name])
            for name, unit in (("frequency", "Hz"), ("quality_factor", "1"))
            if name in middle
        )
        self.start = np.array([middle[spec.name] for spec in self.base])
        # A control variable counts as recorded only where it was varied.
        varied = {
            name: float(np.ptp(v))
            for name, v in self.control.items()
            if np.isfinite(v).all() and np.ptp(v) > 0
        }
        self.scales: Mapping[str, float] = {
            **varied,
            **dict.fromkeys(middle, 1.0),
            **_inverse(varied),
        }
        self.notes = tuple(notes)

    @property
    def blocks(self) -> NDArray[np.int64]:
        """Stretches of neighbouring points, in the order of the first control variable."""
        first = next(iter(self.control.values()))
        place = np.argsort(np.argsort(first, kind="stable"), kind="stable") * BLOCKS // len(first)
        return np.tile(place, len(self._data))[self._used].astype(np.int64)

    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        """Return (f − f_predicted)/σ, then (Q − Q_predicted)/σ."""
        return self._against(self.control, effects, base, values)[self._used]

    def _against(
        self,
        control: dict[str, Array],
        effects: Sequence[Effect],
        base: Values,
        values: Sequence[Values],
    ) -> Array:
        count = len(next(iter(control.values())))
        flat = {
            name: np.full(count, base.get(name, 1.0)) for name in ("frequency", "quality_factor")
        }
        points = apply(
            "points",
            Points(flat["frequency"], flat["quality_factor"], control, self.film),
            effects,
            values,
        )
        return np.concatenate(
            [(data - getattr(points, name)) / sd for name, (data, sd) in self._data.items()]
        )

    def residual_directions(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """A slope and a bend of each quantity against each control variable."""
        found = {}
        sizes = [len(data) for data, _ in self._data.values()]
        for control, axis in self.control.items():
            if control not in self.scales:
                continue
            unit = 2 * (axis - axis.min()) / np.ptp(axis) - 1
            for k, (name, (_, sd)) in enumerate(self._data.items()):
                for power, word in ((1, "slope"), (2, "bend")):
                    rows = [np.zeros(n) for n in sizes]
                    rows[k] = unit**power / sd
                    found[f"{word} of {name} with {control}"] = np.concatenate(rows)[self._used]
        return found

    def candidate_measurements(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Vary each control variable over its range with the others held.

        That separates causes that moved together.
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
        return found

    def systematic(self, unit: str) -> float:
        """Nothing beside the statistics."""
        return 0.0

    def equivalent_solutions(self, base: dict[str, float]) -> list[dict[str, float]]:
        """None: these data leave one solution."""
        return []

    def compare(self, models: Sequence[Named]) -> tuple[Comparison, ...]:
        """Each quantity against each control variable that was varied."""
        count = len(self._used) // len(self._data)
        names = tuple(name for name, *_ in models)
        away = np.full((len(models), len(self._used)), np.nan)
        away[:, self._used] = [
            self.residuals(effects, base, values) for _, effects, base, values in models
        ]
        found = []
        for control, axis in self.control.items():
            if control not in self.scales:
                continue
            order = np.argsort(axis)
            for k, (name, (data, sd)) in enumerate(self._data.items()):
                predicted = data - away[:, k * count : (k + 1) * count] * sd
                curve = Curve(name, axis[order], data[order], sd[order], predicted[:, order])
                unit = "Hz" if name == "frequency" else ""
                found.append(
                    Curves(
                        "series",
                        control.replace("_", " "),
                        CONTROLS[control],
                        name.replace("_", " "),
                        unit,
                        names,
                        (curve,),
                    )
                )
        return tuple(found)

    def describe(self, residuals: Array) -> str:
        """Say which quantity moves, between which values of the control variable."""
        whole = np.full(len(self._used), np.nan)
        whole[self._used] = residuals
        control, axis = next(iter(self.control.items()))
        rows = dict(zip(self._data, np.split(whole, len(self._data)), strict=True))
        worst = max(rows, key=lambda name: np.nanmean(rows[name] ** 2))
        order = np.argsort(axis)
        ends = rows[worst][order[0]], rows[worst][order[-1]]
        span = (
            f"{ends[0]:+.1f}σ at {control} = {axis[order[0]]:.3g} {CONTROLS[control]} to "
            f"{ends[1]:+.1f}σ at {axis[order[-1]]:.3g}"
        )
        return (
            f"{worst} is not constant: from {span} {CONTROLS[control]}; rms "
            f"{np.sqrt(np.nanmean(rows[worst] ** 2)):.2f}σ"
        )


def _inverse(varied: Mapping[str, float]) -> dict[str, float]:
    """Scales of parameters per unit of a control variable, and per its square."""
    return {f"per_{k}": 1 / v for k, v in varied.items()} | {
        f"per_{k}_square": 1 / v**2 for k, v in varied.items()
    }
