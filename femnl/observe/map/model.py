"""Harmonic maps against a simulated mode under a sinusoidal fringe."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from femnl.core.comparison import Comparison, Images
from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.numbers import plain
from femnl.core.readout import Array, ComplexArray
from femnl.core.stages import Fringe, Harmonics, Motion, Placement
from femnl.mechanics.modes import ShapeValues
from femnl.observe.film import SimulatedFilm
from femnl.observe.map.directions import of_harmonics, of_places
from femnl.observe.map.faint import STRAIGHT, contrast_of_faint
from femnl.observe.map.layout import around_places, follows, marked, time_across, where_most
from femnl.observe.map.spots import Axis, Finer, Grid
from femnl.observe.map.thinning import every, step_of
from femnl.observe.model import KnownProduct, MeasurementModel, Named, Thinned, apply
from femnl.observe.residuals import Layout, Quantity, quadratures
from femnl.observe.score_directions import LITTLE, fringe_terms, overtones, uneven
from femnl.optics.harmonics import along_line
from femnl.optics.sampled import harmonics

TILES = 3
"""Tiles along each axis of the map that are held out one by one."""
LARGER = (3.0, 9.0, 27.0, 81.0)
"""Factors by which a faint motion may be larger."""
FAR = (0.4, 0.6, 1.6)
"""Factors on the amplitude at which the harmonics of a deep fringe have a different order of sizes:
an admixed mode of half the motion led fits to 1.8 times the amplitude.
"""
KEPT = 4
"""Places of the map at which shapes are kept: those of the last two tangents too, so that steps of
all other parameters find theirs.
"""
ASIDE = 0.02
"""Part of half the film by which the map is moved to see how the data answer to wrong places and to
blur.
"""


@dataclass(frozen=True, eq=False)
class MapModel(MeasurementModel):
    """Residuals of the harmonics of a driven mode.

    harmonic (n_harmonics,), at least 1; axes: x and y of the whole map [m]; grid: its n_points
    places with data; present and measured (n_harmonics, n_points): where and what [V], 0 where it
    is missing; time (n_points,) [s] at which each place was measured, empty where that was not
    recorded; noise [V] per quadrature; mode: index of the driven mode; frequency [Hz] and drive [V]
    of the drive; step: of so many rows and columns of the measured map, one is in it.
    """

    kind = "map"
    tells_noise = True

    film: SimulatedFilm
    wavelength: float
    harmonic: NDArray[np.int64]
    axes: tuple[Array, Array]
    grid: Grid
    present: NDArray[np.bool_]
    measured: ComplexArray
    time: Array
    noise: float
    mode: int
    frequency: float
    drive: float
    base: tuple[ParameterSpec, ...]
    start: Array
    scales: Mapping[str, float]
    notes: tuple[str, ...]
    step: int = 1

    @property
    def variant(self) -> str:
        """Of how many rows and columns one is in it."""
        return f"every {self.step}" if self.step > 1 else ""

    @cached_property
    def _complete(self) -> bool:
        """Whether no value of the map is missing."""
        return bool(self.present.all())

    @cached_property
    def _finer(self) -> Finer:
        """The grid on which a spot of finite size is averaged."""
        return Finer(Axis.beside(self.axes[0]), Axis.beside(self.axes[1]))

    @cached_property
    def _finer_time(self) -> Array:
        """Time of the finer grid: of the nearest place, whose spot covers it then."""
        if not len(self.time):
            return self.time
        places = np.column_stack([self.grid.x, self.grid.y])
        finer = self._finer.grid
        _, nearest = cKDTree(places).query(np.column_stack([finer.x, finer.y]))
        return self.time[nearest]

    @cached_property
    def _exact(self) -> ShapeValues | None:
        """Shapes at any place, where the film is no rectangle whose projection is exact."""
        return exact_shapes(self.film)

    @cached_property
    def _shapes(self) -> Callable[[bytes, bytes, bool], Array]:
        """Shapes (n_modes, n_points) at the latest places."""
        return lru_cache(maxsize=KEPT)(self._shapes_at)

    @property
    def blocks(self) -> NDArray[np.int64]:
        """Tiles of the map, all harmonics together."""
        tile = [
            np.minimum(TILES * (v - v.min()) / (np.ptp(v) or 1.0), TILES - 1).astype(np.int64)
            for v in (self.grid.x, self.grid.y)
        ]
        whole = np.broadcast_to(tile[0] * TILES + tile[1], self.present.shape)[self.present]
        return np.concatenate([whole, whole])

    @cached_property
    def thinned(self) -> Thinned | None:
        """Every so many rows and columns, where the map has many places."""
        part, coarse = every(self.grid, step := step_of(len(self.grid.x)))
        if step == 1 or not len(part):
            return None
        model = replace(
            self,
            axes=(self.axes[0][::step], self.axes[1][::step]),
            grid=coarse,
            present=self.present[:, part],
            measured=self.measured[:, part],
            time=self.time[part] if len(self.time) else self.time,
            step=step,
        )
        kept = np.isin(np.nonzero(self.present)[1], part)
        return Thinned(model, np.flatnonzero(np.tile(kept, 2)), step)

    @cached_property
    def layout(self) -> Layout:
        """The places around each one, harmonic by harmonic; lines run along the fast axis."""
        return around_places(self.grid, self.present, self._column_by_column)

    @property
    def _column_by_column(self) -> bool:
        """Whether the columns are the slow axis; rows are, where no time was recorded."""
        if not len(self.time):
            return False
        return follows(self.time, self.grid.column) > follows(self.time, self.grid.row)

    def locate(self, residual: int) -> str:
        """Name the harmonic and the place."""
        rows, places = np.nonzero(self.present)
        at = residual % len(rows)
        x = plain(float(self.grid.x[places[at]]) * 1e6, 4)
        y = plain(float(self.grid.y[places[at]]) * 1e6, 4)
        return f"harmonic {self.harmonic[rows[at]]}, x = {x} µm, y = {y} µm"

    @property
    def quantity(self) -> tuple[Array, str]:
        """V of each quadrature."""
        return np.full(2 * int(self.present.sum()), self.noise), "V"

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """Both quadratures of the harmonics."""
        rows, places = np.nonzero(self.present)
        x = self.grid.x[places]
        y = self.grid.y[places]
        axes = {"harmonic": (self.harmonic[rows], ""), "x": (x, "m"), "y": (y, "m")}
        return quadratures("harmonics", "V", np.full(len(rows), self.noise), axes)

    def predict(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> ComplexArray:
        """Return V_n [V], (n_harmonics, n_points)."""
        placement = self._placed(self.grid, effects, base, values)
        if placement.spot == 0:
            voltage = self._read(placement, False, effects, base, values)
        else:
            wider = self._read(
                self._placed(self._finer.grid, effects, base, values), True, effects, base, values
            )
            voltage = self._finer.average(wider, placement.spot, self.grid)
        return apply(
            "harmonics",
            Harmonics(voltage, self.harmonic, self.frequency, self.drive),
            effects,
            values,
        ).values

    def _placed(
        self, grid: Grid, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> Placement:
        """Return where on the film the points of a grid lie."""
        return apply(
            "placement", Placement(grid.x - base["x"], grid.y - base["y"]), effects, values
        )

    def _read(
        self,
        placed: Placement,
        finer: bool,
        effects: Sequence[Effect],
        base: Values,
        values: Sequence[Values],
    ) -> ComplexArray:
        x = placed.x
        y = placed.y
        shapes = self._shapes(x.tobytes(), y.tobytes(), finer)
        swing = np.full(x.shape, base["amplitude"] * np.exp(1j * base["motion_phase"]))
        first = (swing * shapes[self.mode])[None]
        theta = np.full(x.shape, base["theta"])
        motion = Motion(
            first,
            theta,
            x,
            y,
            shapes,
            self.film.modes.frequency,
            self.mode,
            swing,
            self.wavelength,
            self._finer_time if finer else self.time,
        )
        fringe = Fringe(np.array([0, 1], complex), self.wavelength, self.film.model.stack)
        moved = apply("motion", motion, effects, values)
        lit = apply("fringe", fringe, effects, values)
        return base["contrast"] * harmonics(moved, lit, self.harmonic)

    def _shapes_at(self, x: bytes, y: bytes, finer: bool) -> Array:
        here = (np.frombuffer(x), np.frombuffer(y))
        grid = self._finer.grid if finer else self.grid
        if self._exact is not None:
            return self._exact(*here)
        across = np.full(grid.sizes[1], np.nan)
        up = np.full(grid.sizes[0], np.nan)
        across[grid.column], up[grid.row] = here
        straight = np.array_equal(across[grid.column], here[0]) and np.array_equal(
            up[grid.row], here[1]
        )
        # Not turned, so still a grid
        if straight and np.isfinite(across).all() and np.isfinite(up).all():
            return self.film.projection.on_grid(across, up)[:, grid.row, grid.column]
        return self.film.projection.at(*here)

    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        """Return (V − V_predicted)/σ of all real, then of all imaginary parts."""
        return self._real(self.measured - self.predict(effects, base, values))

    def _real(self, volts: ComplexArray) -> Array:
        kept = volts.ravel() if self._complete else volts[self.present]
        return np.concatenate([kept.real, kept.imag]) / self.noise

    def residual_directions(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return how residuals answer when each stage is changed in free form.

        These are gain and phase of harmonics, and constants added to them; motion, phase of the
        fringe and signal that vary; places that are wrong or blurred; more terms of the fringe;
        motion at multiples of the drive, of every shape.
        """
        volts = self.predict(effects, base, values)
        plain = self.residuals(effects, base, values)

        def moved(name: str, step: float) -> Array:
            return self.residuals(effects, {**base, name: base[name] + step}, values) - plain

        found = of_harmonics(self.harmonic, volts, self._real)
        swung = moved("amplitude", LITTLE * base["amplitude"])
        turned = moved("theta", LITTLE)
        for name, factor in uneven(self.grid.x, self.grid.y).items():
            here = self._everywhere(factor)
            found[f"motion that varies as {name}"] = here * swung
            found[f"phase of the fringe that varies as {name}"] = here * turned
            found[f"signal that varies as {name}"] = here * self._real(volts)
        across, up = (self._everywhere(place) for place in (self.grid.x, self.grid.y))
        found |= of_places(moved, ASIDE * self.scales["reach"], across, up)
        found |= fringe_terms(self, effects, base, values)
        placed = self._placed(self.grid, effects, base, values)
        shapes = self._shapes(placed.x.tobytes(), placed.y.tobytes(), False)
        for name, answer in overtones(self, effects, base, values).items():
            found |= {
                f"{name} as mode {j + 1}": self._everywhere(shape) * answer
                for j, shape in enumerate(shapes)
            }
        return found

    def _everywhere(self, factor: Array) -> Array:
        """Return a function of the place (n_points,) at every residual."""
        return np.tile(np.broadcast_to(factor, self.present.shape)[self.present], 2)

    def candidate_measurements(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return the same map at other amplitudes of the motion, and along its other axis."""
        found = {
            f"the same map at {factor:g} times the amplitude": self._real(
                self.predict(effects, {**base, "amplitude": factor * base["amplitude"]}, values)
            )
            for factor in (0.5, 2.0)
        }
        if len(self.time):
            across = replace(self, time=time_across(self.grid, self.time, self._column_by_column))
            found["the same map line by line along its other axis"] = self._real(
                across.predict(effects, base, values)
            )
        return found

    def known_product(self, base: dict[str, float]) -> KnownProduct | None:
        """Return contrast times the rest of the first harmonic, where the motion is faint."""
        return contrast_of_faint(base, self.wavelength)

    def equivalent_solutions(self, base: dict[str, float]) -> list[dict[str, float]]:
        """Return larger motions under less contrast, where the motion is faint.

        Only the product of a faint motion with the contrast shows.
        """
        depth = 4 * np.pi / self.wavelength * base["amplitude"]
        factors = [factor for factor in LARGER if depth * factor < STRAIGHT]
        return [
            base | {"amplitude": factor * base["amplitude"], "contrast": base["contrast"] / factor}
            for factor in factors
        ]

    def far_from(self, base: dict[str, float]) -> list[dict[str, float]]:
        """Return other amplitudes under as much less or more contrast."""
        return [
            base | {"amplitude": factor * base["amplitude"], "contrast": base["contrast"] / factor}
            for factor in FAR
        ]

    def turned(self, base: Values) -> dict[str, float]:
        """Return phases of motion and fringe at which the film is on the other side.

        Under a cosine −θ and antiphase are the same.
        """
        names = [spec.name for spec in self.base]
        theta, phase = (self.start[names.index(name)] for name in ("theta", "motion_phase"))
        mirrored = (-base["theta"] - theta + np.pi) % (2 * np.pi) - np.pi + theta
        return {
            "theta": float(mirrored),
            "motion_phase": base["motion_phase"]
            + (np.pi if base["motion_phase"] <= phase else -np.pi),
        }

    def compare(self, models: Sequence[Named]) -> tuple[Comparison, ...]:
        """Compare all harmonics on the grid of the map.

        Along a single line, the quadrature that holds the signal of each harmonic is compared.
        """
        predicted = np.stack(
            [
                self._on_grid(self.predict(effects, base, values))
                for _, effects, base, values in models
            ]
        )
        names = tuple(name for name, *_ in models)
        measured = self._on_grid(self.measured)
        images = Images("map", names, self.harmonic, *self.axes, measured, predicted, self.noise)
        return (along_line(images) if 1 in self.grid.sizes else images,)

    def marked(
        self, comparisons: tuple[Comparison, ...], residuals: Sequence[int]
    ) -> tuple[Comparison, ...]:
        """Mark places that no fit has seen."""
        return marked(comparisons, self.grid, self.present, residuals)

    def _on_grid(self, volts: ComplexArray) -> ComplexArray:
        whole = np.full((len(self.harmonic), *self.grid.sizes), complex(np.nan, np.nan))
        whole[:, self.grid.row, self.grid.column] = np.where(
            self.present, volts, complex(np.nan, np.nan)
        )
        return whole

    def describe(self, residuals: Array) -> str:
        """Say which harmonic deviates most, and where on the map."""
        return where_most(residuals, self.harmonic, self.grid, self.present)


def exact_shapes(film: SimulatedFilm) -> ShapeValues | None:
    """Return the shapes of a film whose outline is no rectangle, None for the others.

    The projection of a rectangle's modes is as exact, and quicker.
    """
    return ShapeValues(film.modes) if film.model.outline.size is None else None
