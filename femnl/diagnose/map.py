"""Harmonic maps against a simulated mode under a sinusoidal fringe."""

from collections.abc import Mapping, Sequence
from functools import lru_cache, partial

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from femnl.core.comparison import Comparison, Images
from femnl.core.effect import Effect, Kind, ParameterSpec, Values
from femnl.core.readout import Array, ComplexArray
from femnl.core.stages import Fringe, Harmonics, Motion, Placement
from femnl.diagnose.score_directions import LITTLE, fringe_terms, overtones, uneven
from femnl.fits.map.fit import fit_map
from femnl.io.measurement import noise_sd
from femnl.mechanics.modes import ShapeValues
from femnl.observe.film import SimulatedFilm
from femnl.observe.map.spots import Axis, Finer, Grid
from femnl.observe.model import Named, Ranked, apply
from femnl.optics.harmonics import along_line
from femnl.optics.sampled import harmonics

TILES = 3
"""Tiles along each axis of the map that are held out one by one."""
TRIED = 6
"""Lowest modes that a map without drive frequency may show."""
COARSE = 24
"""Points along each axis of the thinned map in which the mode is sought."""
EXPLAINED = 0.1
"""Part of the signal's power that the right mode may leave; wrong ones leave a third and more."""
NEAR = 0.1
"""Relative distance of a mode's simulated frequency from the drive up to which it may be the one
that is driven.
"""
STRAIGHT = 1.0
"""Modulation z up to which the first harmonic hardly bends."""
LARGER = (3.0, 9.0, 27.0, 81.0)
"""Factors by which a faint motion may be larger."""
KEPT = 4
"""Places of the map at which shapes are kept: those of the last two tangents too, so that steps of
all other parameters find theirs.
"""
ASIDE = 0.02
"""Part of half the film by which the map is moved to see how the data answer to wrong places and to
blur.
"""


class MapModel:
    """Residuals of the harmonics of a driven mode; see `MeasurementModel`."""

    kind: Kind = "map"
    needs_global_search = False
    jumps: tuple[str, ...] = ()
    independent_blocks: tuple[Mapping[str, NDArray[np.bool_]], ...] = ()
    ranked: tuple[Ranked, ...] = ()

    def __init__(self, dataset: xr.Dataset, film: SimulatedFilm) -> None:
        values = np.asarray(dataset["real"].values + 1j * dataset["imag"].values)
        self.harmonic = dataset["harmonic"].values.astype(np.int64)
        values = values[self.harmonic >= 1]
        self.harmonic = self.harmonic[self.harmonic >= 1]
        self._axes = np.asarray(dataset["x"].values, float), np.asarray(dataset["y"].values, float)
        across, up = np.meshgrid(*self._axes)
        flat = values.reshape(len(self.harmonic), -1)
        used = np.flatnonzero(np.isfinite(flat).any(axis=0))
        sizes = dataset.sizes["y"], dataset.sizes["x"]
        self._grid = Grid(across.ravel()[used], up.ravel()[used], *np.divmod(used, sizes[1]), sizes)
        self._finer = Finer(Axis.beside(self._axes[0]), Axis.beside(self._axes[1]))
        self._present = np.isfinite(flat[:, used])
        self._values = np.where(self._present, flat[:, used], 0)
        self.noise, note = noise_sd(dataset)
        self.film = film
        self.wavelength = float(dataset.attrs["wavelength"])
        self._exact = ShapeValues(film.modes) if film.model.outline.size is None else None
        self._shapes = lru_cache(maxsize=KEPT)(self._shapes_at)
        drive = dataset.attrs.get("drive_frequency")
        self.mode, fitted, told = self._find_mode(dataset, None if drive is None else float(drive))
        self.frequency = float(film.modes.frequency[self.mode]) if drive is None else float(drive)
        self.drive = float(dataset.attrs.get("drive", 1.0))
        z = self.wavelength / (4 * np.pi)
        reach = film.projection.reach
        self.base: tuple[ParameterSpec, ...] = (
            ParameterSpec("amplitude", "m", 0.0, 40 * z),
            ParameterSpec(
                "contrast", "V", -10 * abs(fitted["contrast"]), 10 * abs(fitted["contrast"])
            ),
            ParameterSpec(
                "theta", "rad", fitted["fringe_phase"] - np.pi, fitted["fringe_phase"] + np.pi
            ),
            ParameterSpec(
                "motion_phase",
                "rad",
                fitted["motion_phase"] - np.pi,
                fitted["motion_phase"] + np.pi,
            ),
            ParameterSpec("x", "m", -0.3 * reach, 0.3 * reach),
            ParameterSpec("y", "m", -0.3 * reach, 0.3 * reach),
        )
        names = ("amplitude", "contrast", "fringe_phase", "motion_phase", "x", "y")
        self.start = np.array([fitted[name] for name in names])
        self.scales: Mapping[str, float] = {
            "reach": reach,
            "wavelength": self.wavelength,
            "slope": abs(fitted["contrast"]) / self.drive,
            "period": 1 / self.frequency,
            **({"stack": _gap(film)} if film.model.stack is not None else {}),
        }
        label = film.modes.label[self.mode] or str(self.mode + 1)
        self.notes: tuple[str, ...] = (f"map: {note}", f"map: shows mode {label}, {told}")

    def _find_mode(
        self, dataset: xr.Dataset, drive: float | None
    ) -> tuple[int, dict[str, float], str]:
        """Return the mode whose shape fits a thinned map best, with its fit."""
        frequency = self.film.modes.frequency
        modes = [
            k
            for k in range(len(frequency))
            if drive is not None and abs(drive / frequency[k] - 1) < NEAR
        ] or list(range(TRIED))
        thin = {
            axis: slice(None, None, max(1, dataset.sizes[axis] // COARSE)) for axis in ("x", "y")
        }
        coarse = (
            dataset.isel(thin)
            .isel(harmonic=np.flatnonzero(dataset["harmonic"].values >= 1))
            .assign_attrs(noise_sd=self.noise)
        )

        def shape(k: int, x: Array, y: Array) -> Array:
            return np.asarray((self._exact or self.film.projection.at)(x, y)[k])

        power = float(np.mean(np.abs(self._values[self._present]) ** 2) / (2 * self.noise**2))
        fits = {}
        for k in modes:
            fits[k] = fit_map(coarse, partial(shape, k), registration=("x", "y")).fit
            if fits[k].chi2_reduced < EXPLAINED * power:
                break
        best = min(fits, key=lambda k: fits[k].chi2_reduced)
        why = "the first that fits" if drive is None else "near the drive frequency"
        return best, _upright({name: p.value for name, p in fits[best].parameters.items()}), why

    @property
    def blocks(self) -> NDArray[np.int64]:
        """Tiles of the map, all harmonics together."""
        tile = [
            np.minimum(TILES * (v - v.min()) / (np.ptp(v) or 1.0), TILES - 1).astype(np.int64)
            for v in (self._grid.x, self._grid.y)
        ]
        whole = np.broadcast_to(tile[0] * TILES + tile[1], self._present.shape)[self._present]
        return np.concatenate([whole, whole])

    def predict(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> ComplexArray:
        """Return V_n [V], (n_harmonics, n_points)."""
        placement = self._placed(self._grid, effects, base, values)
        if placement.spot == 0:
            voltage = self._read(placement, False, effects, base, values)
        else:
            wider = self._read(
                self._placed(self._finer.grid, effects, base, values), True, effects, base, values
            )
            voltage = self._finer.average(wider, placement.spot, self._grid)
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
            first, theta, x, y, shapes, self.film.modes.frequency, self.mode, swing, self.wavelength
        )
        fringe = Fringe(np.array([0, 1], complex), self.wavelength, self.film.model.stack)
        moved = apply("motion", motion, effects, values)
        lit = apply("fringe", fringe, effects, values)
        return base["contrast"] * harmonics(moved, lit, self.harmonic)

    def _shapes_at(self, x: bytes, y: bytes, finer: bool) -> Array:
        here = (np.frombuffer(x), np.frombuffer(y))
        grid = self._finer.grid if finer else self._grid
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
        return self._real(self._values - self.predict(effects, base, values))

    def _real(self, volts: ComplexArray) -> Array:
        kept = volts[self._present] / self.noise
        return np.concatenate([kept.real, kept.imag])

    def residual_directions(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Each stage changed in free form.

        Gain and phase of harmonics, and constants added to them; motion, phase of the fringe and
        signal that vary; places that are wrong or blurred; more terms of the fringe; motion at
        multiples of the drive, of every shape.
        """
        volts = self.predict(effects, base, values)
        plain = self.residuals(effects, base, values)
        found: dict[str, Array] = {}
        for k, n in enumerate(self.harmonic):
            only, constant = np.zeros((2, *volts.shape), complex)
            only[k] = volts[k]
            constant[k] = 1.0
            found |= {
                f"gain of harmonic {n}": self._real(only),
                f"phase of harmonic {n}": self._real(1j * only),
            }
            found |= {
                f"constant in harmonic {n}": self._real(constant),
                f"constant in quadrature of harmonic {n}": self._real(1j * constant),
            }

        def moved(name: str, step: float) -> Array:
            return self.residuals(effects, {**base, name: base[name] + step}, values) - plain

        swung = moved("amplitude", LITTLE * base["amplitude"])
        turned = moved("theta", LITTLE)
        for name, factor in uneven(self._grid.x, self._grid.y).items():
            here = self._everywhere(factor)
            for what, answer in (
                ("motion", swung),
                ("phase of the fringe", turned),
                ("signal", self._real(volts)),
            ):
                found[f"{what} that varies as {name}"] = here * answer
        slopes = {}
        for axis in ("x", "y"):
            there, back = (moved(axis, side * ASIDE * self.scales["reach"]) for side in (1, -1))
            found[f"blur along {axis}"] = there + back
            slopes[axis] = there - back
        across = self._everywhere(self._grid.x)
        up = self._everywhere(self._grid.y)
        # A turn and a shear: on their own, x moved with y and y moved with x are all but the same
        # for most modes.
        found |= {
            "longer steps along x": across * slopes["x"],
            "longer steps along y": up * slopes["y"],
            "axes that are turned": up * slopes["x"] - across * slopes["y"],
            "axes at no right angle": up * slopes["x"] + across * slopes["y"],
        }
        found |= fringe_terms(self, effects, base, values)
        placed = self._placed(self._grid, effects, base, values)
        shapes = self._shapes(placed.x.tobytes(), placed.y.tobytes(), False)
        for name, answer in overtones(self, effects, base, values).items():
            found |= {
                f"{name} as mode {j + 1}": self._everywhere(shape) * answer
                for j, shape in enumerate(shapes)
            }
        return found

    def _everywhere(self, factor: Array) -> Array:
        """Return a function of the place (n_points,) at every residual."""
        return np.tile(np.broadcast_to(factor, self._present.shape)[self._present], 2)

    def candidate_measurements(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """The same map at other amplitudes of the motion."""
        return {
            f"the same map at {factor:g} times the amplitude": self._real(
                self.predict(effects, {**base, "amplitude": factor * base["amplitude"]}, values)
            )
            for factor in (0.5, 2.0)
        }

    def systematic(self, unit: str) -> float:
        """Nothing beside the statistics."""
        return 0.0

    def equivalent_solutions(self, base: dict[str, float]) -> list[dict[str, float]]:
        """Of a faint motion, larger ones under less contrast.

        Only its product with the contrast shows.
        """
        depth = 4 * np.pi / self.wavelength * base["amplitude"]
        factors = [factor for factor in LARGER if depth * factor < STRAIGHT]
        return [
            base | {"amplitude": factor * base["amplitude"], "contrast": base["contrast"] / factor}
            for factor in factors
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
        """All harmonics on the grid of the map.

        Along a single line, in the quadrature that holds each one's signal.
        """
        predicted = np.stack(
            [
                self._on_grid(self.predict(effects, base, values))
                for _, effects, base, values in models
            ]
        )
        names = tuple(name for name, *_ in models)
        measured = self._on_grid(self._values)
        images = Images("map", names, self.harmonic, *self._axes, measured, predicted, self.noise)
        return (along_line(images) if 1 in self._grid.sizes else images,)

    def _on_grid(self, volts: ComplexArray) -> ComplexArray:
        whole = np.full((len(self.harmonic), *self._grid.sizes), complex(np.nan, np.nan))
        whole[:, self._grid.row, self._grid.column] = np.where(
            self._present, volts, complex(np.nan, np.nan)
        )
        return whole

    def describe(self, residuals: Array) -> str:
        """Say which harmonic deviates most, and where on the map."""
        half = len(residuals) // 2
        power = np.zeros(self._present.shape)
        power[self._present] = (residuals[:half] ** 2 + residuals[half:] ** 2) / 2
        by_order = power.sum(axis=1) / np.maximum(self._present.sum(axis=1), 1)
        k = int(np.argmax(by_order))
        p = int(np.argmax(power.sum(axis=0)))
        rms = ", ".join(
            f"{n}: {np.sqrt(value):.2f}σ" for n, value in zip(self.harmonic, by_order, strict=True)
        )
        place = f"x = {self._grid.x[p] * 1e6:.0f} µm, y = {self._grid.y[p] * 1e6:.0f} µm"
        return (
            f"harmonic {self.harmonic[k]} deviates most, and most strongly near {place}; rms "
            f"by harmonic {rms}"
        )


def _upright(found: dict[str, float]) -> dict[str, float]:
    """Choose between two motions that read the same, u at a fringe phase θ and −u at −θ.

    Take the one within a quarter turn of the drive.
    """
    phase = (found["motion_phase"] + np.pi / 2) % (2 * np.pi) - np.pi / 2
    if phase <= np.pi / 2:
        return found | {"motion_phase": phase}
    turned = (np.pi - found["fringe_phase"]) % (2 * np.pi) - np.pi
    return found | {"motion_phase": phase - np.pi, "fringe_phase": turned}


def _gap(film: SimulatedFilm) -> float:
    stack = film.model.stack
    return 0.0 if stack is None else stack.layers[stack.gap].thickness
