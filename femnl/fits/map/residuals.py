"""Maps, mode shape and free parameters put together as one least-squares problem."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter
from scipy.optimize import least_squares

from femnl.core.readout import Array, ComplexArray
from femnl.fits.covariance import unseen
from femnl.fits.held import Held, hold_fixed
from femnl.fits.map.start import LARGEST, starts
from femnl.observe.map.forward import REGISTRATION, MapData, Shape, predict, slopes
from femnl.optics.unit_fringe import OVERTONE

N_STARTS = 6
SCALES = (0.93, 1.0, 1.07)
ROTATIONS = (-0.1, 0.0, 0.1)
"""Placements that the coarse search tries; the refinement follows on from there."""
WALL = 1e9
"""Residual of impossible parameters."""
TABLE = 257
REACH = 1.6
"""Points along a side of the table of ξ, and its half side in parts of the farthest point of the
map.
"""


@dataclass(frozen=True)
class MapResiduals:
    """The layout of the parameter vector.

    U, then for each map V_C, θ, φ and those of its placement that are free.

    fixed: values by label that every search holds, see `labels`.
    """

    maps: list[MapData]
    shape: Shape
    registration: tuple[str, ...]
    overtones: tuple[int, ...] = ()
    fixed: Mapping[str, float] = field(default_factory=dict)

    @property
    def own(self) -> tuple[str, ...]:
        """Parameters that each map has for itself."""
        placement = [name for name in REGISTRATION if name in self.registration]
        free = [
            OVERTONE.format(k=k, part=part) for k in self.overtones for part in ("real", "imag")
        ]
        return ("contrast", "fringe_phase", "motion_phase", *placement, *free)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the parameters; with several maps those of a map carry ":" and its name."""
        each = [
            f"{name}:{data.name}" if data.name else name for data in self.maps for name in self.own
        ]
        return ("amplitude", *each)

    @property
    def held(self) -> Held:
        """What is held of the parameter vector."""
        return hold_fixed(self.labels, self.fixed, "these maps")

    @property
    def n_points(self) -> int:
        """Real numbers measured."""
        return int(sum(2 * data.present.sum() for data in self.maps))

    def pack(self, amplitude: float, values: Sequence[Mapping[str, float]]) -> Array:
        """Return the parameter vector."""
        return np.array([amplitude, *(own.get(name, 0.0) for own in values for name in self.own)])

    def unpack(self, vector: Array) -> list[dict[str, float]]:
        """Return every parameter of each map, the fixed ones included."""
        fixed = {"amplitude": float(vector[0]), "x": 0.0, "y": 0.0, "scale": 1.0, "rotation": 0.0}
        rows = vector[1:].reshape(len(self.maps), -1).tolist()
        return [fixed | dict(zip(self.own, row, strict=True)) for row in rows]

    def predictions(self, vector: Array) -> list[ComplexArray]:
        """Return V_n at the points of each map."""
        return [
            predict(data, self.shape, values)
            for data, values in zip(self.maps, self.unpack(vector), strict=True)
        ]

    def residuals(self, vector: Array) -> Array:
        """Return (data − model)/noise as real numbers, map by map.

        Where no map can be, the residuals are a wall, so that no step leads there.
        """
        if not self._possible(vector):
            return np.full(self.n_points, WALL)
        parts = [
            _real((data.values - signal)[data.present] / data.noise)
            for data, signal in zip(self.maps, self.predictions(vector), strict=True)
        ]
        return np.concatenate(parts)

    def _possible(self, vector: Array) -> bool:
        """Say whether motion and membrane are within the search.

        The motion within twice its range, the membrane within twice and half its size.
        """
        depth = max(data.wavenumber for data in self.maps) * abs(vector[0])
        return bool(
            depth < 2 * LARGEST and all(0.5 < values["scale"] < 2 for values in self.unpack(vector))
        )

    def jacobian(self, vector: Array) -> Array:
        """Return the derivatives of the residuals, (n_points, n_parameters)."""
        result = np.zeros((self.n_points, vector.size))
        row = 0
        for i, (data, values) in enumerate(zip(self.maps, self.unpack(vector), strict=True)):
            by = slopes(data, self.shape, values)
            columns = {
                "amplitude": 0,
                **{name: 1 + i * len(self.own) + j for j, name in enumerate(self.own)},
            }
            n_rows = 2 * int(data.present.sum())
            for name, column in columns.items():
                result[row : row + n_rows, column] = -_real(by[name][data.present] / data.noise)
            row += n_rows
        return result

    def unit(self, vector: Array) -> Array:
        """Return a step of each parameter that would matter.

        It is a nanometre for the amplitude, the contrast itself, the spacing of the points for the
        place, and 1 for the others.
        """
        steps = {"amplitude": 1e-9} | dict.fromkeys(self.own, 1.0)
        own = [
            steps | {"contrast": abs(values["contrast"]), "x": data.spacing, "y": data.spacing}
            for data, values in zip(self.maps, self.unpack(vector), strict=True)
        ]
        return self.pack(steps["amplitude"], own)

    def refine(
        self, vector: Array, held: Sequence[int] = (), most: int = 200
    ) -> tuple[Array, float]:
        """Return the nearest minimum of χ² and χ² there, or where `most` evaluations led.

        Parameters with the indices `held` stay, and those that are `fixed` have their values.

        Parameters that the data do not see stay as well, as nothing would keep them from drifting
        away.
        """
        vector = self.held.put(vector)
        stay = np.union1d(np.asarray(held, int), np.flatnonzero(~self.held.free))
        dead = np.flatnonzero(unseen(self.jacobian(vector), self.unit(vector)))
        free = np.setdiff1d(np.arange(vector.size), np.union1d(stay, dead))

        def at(values: Array) -> Array:
            whole = vector.copy()
            whole[free] = values
            return whole

        def residuals(values: Array) -> Array:
            return self.residuals(at(values))

        def jacobian(values: Array) -> Array:
            # MINPACK copies any other order, and does not say so where memory is short
            return np.ascontiguousarray(self.jacobian(at(values))[:, free])

        found = least_squares(
            residuals,
            vector[free],
            jacobian,
            method="lm",
            x_scale="jac",
            xtol=1e-10,
            ftol=1e-12,
            gtol=1e-12,
            max_nfev=most,
        )
        return at(found.x), float(2 * found.cost)

    def tabulated(self) -> "MapResiduals":
        """Return the same problem with ξ from a table about the map.

        Quick where a finite-element shape is slow, and close to it.
        """
        half = REACH * max(
            max(np.abs(data.x).max(), np.abs(data.y).max(), data.spacing) for data in self.maps
        )
        axis = np.linspace(-half, half, TABLE)
        coefficients = spline_filter(self.shape(*np.meshgrid(axis, axis)))

        def shape(x: Array, y: Array) -> Array:
            return map_coordinates(
                coefficients, np.stack([y + half, x + half]) / (axis[1] - axis[0]), prefilter=False
            )

        return replace(self, shape=shape)

    def starts(self) -> list[Array]:
        """Return starting points at the best optima of U.

        The membrane lies about the origin or about the centre of the signal.
        """
        placements = [self._placements(data) for data in self.maps]
        found = [
            self.pack(start.amplitude, start.maps)
            for start in starts(
                self.maps, self.shape, N_STARTS, placements, self.fixed.get("amplitude")
            )
        ]
        if not self.fixed:
            return found
        return [self.held.put(equal) for start in found for equal in self._equal(start)]

    def _equal(self, vector: Array) -> list[Array]:
        """Return solutions that a symmetric fringe makes equal where nothing is held.

        V_C → −V_C, θ → θ + π, and θ → −θ, φ → φ + π, in all maps alike.
        """
        found = []
        for flipped, mirrored in product((False, True), repeat=2):
            values = self.unpack(vector)
            for own in values:
                if flipped:
                    own["contrast"] *= -1
                    own["fringe_phase"] += np.pi
                if mirrored:
                    own["fringe_phase"] *= -1
                    own["motion_phase"] += np.pi
            found.append(self.pack(vector[0], values))
        return found

    def _placements(self, data: MapData) -> list[dict[str, float]]:
        power = np.maximum(
            np.sum(np.abs(data.values) ** 2 - 2 * data.noise**2 * data.present, axis=0), 0
        )
        weight = power / power.sum() if power.any() else np.zeros_like(power)
        centres = {
            (0.0, 0.0),
            (
                float(weight @ data.x) * ("x" in self.registration),
                float(weight @ data.y) * ("y" in self.registration),
            ),
        }
        scales = SCALES if "scale" in self.registration else (1.0,)
        rotations = ROTATIONS if "rotation" in self.registration else (0.0,)
        return [
            {"x": x, "y": y, "scale": scale, "rotation": rotation}
            for (x, y), scale, rotation in product(sorted(centres), scales, rotations)
        ]


def _real(values: ComplexArray) -> Array:
    """Return real and imaginary parts side by side."""
    return np.ascontiguousarray(values).view(float)
