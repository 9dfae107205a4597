"""Modes of a film, with the error bars of their numbers."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from femnl.core.arrays import freeze
from femnl.core.discretisation_error import (
    ERRORS,
    NO_ERRORS,
    ROUNDING,
    ratio_remainder,
    remainder,
    settle,
)
from femnl.core.domain import Domain, Prestress
from femnl.core.kinds import function
from femnl.core.numbers import with_error
from femnl.core.tables import Table, Tabulated, dataframe, dataset

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

DEGENERATE = 1e-6  # relative difference of frequencies up to which modes count as sharing one
# On the remainder of a largest value: departures are the largest in whole triangles
PEAK_SAFETY = 0.68
PEAK_UNEVEN = 3.2  # the same where holes make the stress uneven, and shapes settle less evenly
STEADY = 0.02  # of the last difference between degrees, what is taken to be left at least
# Of the last difference, what ratios and largest values keep at least where the stress relaxes
# unevenly: the geometric mean of what is left where all settles alike, STEADY, and where it settles
# in parts, REENTRANT
APART = 0.1
# The same at an inner or yielding corner, where a clamped edge goes over into a free one, or where
# a taper's foot kinks the film: that converges slowly in the degree
REENTRANT = 0.5


@dataclass(frozen=True)
class Modes(Tabulated):
    """Prestressed modes by rising frequency; shapes have max|ξ| = 1, positive at that point.

    frequency [Hz], effective_mass [kg] (∫ρhξ² over the whole film), shapes (n_modes, n_dofs) at the
    dofs of the scalar element of the given degree on the wedge's mesh; parity[i] holds the signs of
    mode i under the wedge's mirrors (+1 even, −1 odd; empty for the whole film). label "(m,n)" by
    overlap with ideal shapes, None where it has none.
    coarse: the same modes at one degree less on the same mesh, in the same order, which may in turn
    have theirs: what the errors are estimated from. departure (n_modes,), of such counterparts: how
    far the mass-normalised shape is from that of the finest modes, at most, in the triangles where
    that is largest, relative to its largest value; NaN where a mode has no counterpart. coupling
    (n_modes, n_modes) [Hz], of counterparts that were turned to match: (aᵢ, K aⱼ)/(8π²√(fᵢfⱼ)) of
    their operator, which lets neighbours in frequency mix; next to nothing where a symmetry of film
    and mesh keeps two modes apart, NaN where none were turned.
    first: number of the lowest of these modes among all modes of the film, from 1; above 1 where
    modes near a frequency were solved alone.
    """

    prestress: Prestress
    degree: int
    frequency: Array
    effective_mass: Array
    shapes: Array
    parity: tuple[tuple[int, ...], ...]
    label: tuple[str | None, ...]
    coarse: "Modes | None" = None
    departure: Array | None = None
    coupling: Array | None = None
    first: int = 1

    def __post_init__(self) -> None:
        freeze(self)

    def __repr__(self) -> str:
        """Device, number of modes, and the range of their frequencies."""
        low = self.frequency.min()
        high = self.frequency.max()
        return (
            f"<Modes of {self.domain.model.name}: {len(self.frequency)}, from {low:.7g} Hz to "
            f"{high:.7g} Hz, degree {self.degree}>"
        )

    @property
    def domain(self) -> Domain:
        """The meshed film that the modes were solved on."""
        return self.prestress.domain

    @property
    def ratio(self) -> Array:
        """f/f₁, NaN where the lowest mode of the film is not among these."""
        lowest = self.frequency[0] if self.first == 1 else np.nan
        return np.asarray(self.frequency / lowest)

    @property
    def number(self) -> NDArray[np.int64]:
        """Number of each mode among all modes of the film, from 1."""
        return self.first + np.arange(len(self.frequency))

    @property
    def grades(self) -> tuple["Modes", ...]:
        """These modes and their counterparts of lower degrees, finest first."""
        return (self, *(self.coarse.grades if self.coarse is not None else ()))

    @property
    def frequency_error(self) -> Array:
        """Discretisation error of f [Hz], an upper estimate.

        Infinite without counterparts of lower degree.
        """
        f = self.frequency
        return self._remainder([m.frequency for m in self.grades], f) + self.domain.misfit * f

    @property
    def ratio_error(self) -> Array:
        """Discretisation error of f/f₁, in the same way.

        It is less than that of f where all modes err alike.
        """
        inner = self.number > 1
        if self.coarse is None:
            return np.where(inner, np.inf, 0.0)
        relative = ratio_remainder(
            [m.frequency for m in self.grades[:3]], self._least_without_holes, self._apart
        )
        return np.asarray(np.where(inner, self.ratio * (relative + 2 * self.domain.misfit), 0.0))

    @property
    def peak_error(self) -> Array:
        """Error of max|ξ| of the mass-normalised shapes, relative, in the same way.

        M_eff goes as its power −2.

        Counterparts are turned to match: what neighbours in frequency still mix is added.
        """
        departures = [m.departure for m in self.grades if m.departure is not None]
        if not departures:
            return np.full(len(self.frequency), np.inf)
        last = departures[0]
        before = departures[1] if len(departures) > 1 else np.full(last.shape, np.nan)
        safety = PEAK_UNEVEN if self.domain.model.pierced else PEAK_SAFETY
        left = settle(last, before, safety, self._apart)
        return np.asarray(np.where(np.isnan(left), np.inf, left + ROUNDING) + self._mixing)

    @property
    def _mixing(self) -> Array:
        """Return the angles by which the discretisation mixes each shape with its neighbours.

        The sum of cᵢⱼ/|fᵢ − fⱼ| over the couplings cᵢⱼ that the discretisation leaves.
        """
        f = self.frequency
        couplings = [m.coupling for m in self.grades if m.coupling is not None]
        if not couplings:
            return np.zeros(len(f))
        gap = np.abs(f[:, None] - f[None, :])
        # What symmetry forbids is no sample of how couplings fall; shapes that share ω² up to
        # DEGENERATE were turned to a canonical pair.
        forbidden = ~(np.abs(couplings[0]) > ROUNDING * f)
        known = [np.where(forbidden | (gap < DEGENERATE / 2 * f), np.nan, c) for c in couplings]
        left = remainder([np.zeros_like(gap), *known][:3], np.sqrt(np.outer(f, f)), self._least)
        return np.asarray(
            np.sum(
                np.minimum(
                    np.where(np.isfinite(left), left, 0.0) / np.where(gap > 0, gap, np.inf), 1.0
                ),
                axis=1,
            )
        )

    @property
    def effective_mass_error(self) -> Array:
        """Discretisation error of m_eff [kg], in the same way."""
        return np.asarray(2 * self.effective_mass * self.peak_error)

    def _remainder(self, values: list[Array], scale: Array) -> Array:
        if len(values) < 2:
            return np.full(len(scale), np.inf)
        return remainder(values[:3], scale, self._least)

    @property
    def _least(self) -> float:
        # Around holes the errors of stress and deflection have opposite signs, and settle apart.
        uneven = self.domain.model.released or self.domain.model.layers
        return REENTRANT if uneven else self._least_without_holes

    @property
    def _apart(self) -> float:
        """Return the least part of the last difference that some errors keep.

        These are the errors of ratios and of largest values. Where stress and deflection settle
        apart, shapes and ratios also seem to settle at once.
        """
        return APART if self._least >= REENTRANT else 0.0

    @property
    def _least_without_holes(self) -> float:
        model = self.domain.model
        reentrant = any(angle > np.pi + 1e-6 for _, angle in model.outline.corners)
        # Springs in plane, and a strip of another film, leave the stress uneven at every corner.
        uneven = len(model.outline.corners) > 0 and not (
            model.clamp.rigid_in_plane and model.overhang is None
        )
        passing = len(model.outline.passing_corners) > 0
        # With it, the layers of bending leave more
        kinked = model.film.taper > 0 and not model.bending
        return REENTRANT if reentrant or uneven or kinked or passing else STEADY

    @property
    def stiffness(self) -> Array:
        """Modal stiffness k = m_eff ω², in N/m."""
        return np.asarray(self.effective_mass * (2 * np.pi * self.frequency) ** 2)

    def plot(self) -> "Figure":
        """Draw the first ten shapes from above, with labels and frequencies.

        Raises: MissingLibraryError without OpenGL.
        """
        # By name, as everything drawn here: this floor imports none of a higher one
        figure: Figure = function("femnl.plot.mechanics:mode_gallery")(self)
        return figure

    def to_dataset(self) -> "xr.Dataset":
        """Return frequencies, ratios, masses and stiffnesses with errors, and the shapes.

        Returns: Dataset over `mode` (from 1), SI units as attributes; `shape` (mode, point) with
            max|ξ| = 1 at points x, y [m] of the whole film.
        """
        surface = function("femnl.io.results.surface:unfold")(self)
        x, y = surface.points.T
        places = {"x": ("point", x, {"units": "m"}), "y": ("point", y, {"units": "m"})}
        shape = (("mode", "point"), surface.shapes, {"units": "1"})
        return self._columns().assign_coords(places).assign(shape=shape)

    def to_dataframe(self) -> "pd.DataFrame":
        """Return a row a mode (from 1), in SI; `attrs["units"]` holds the units by column."""
        return dataframe(self._columns())

    def _columns(self) -> "xr.Dataset":
        found = dataset(
            "mode",
            {
                "mode": (self.number, ""),
                "label": ([label or "" for label in self.label], ""),
            },
            {
                "frequency": (self.frequency, "Hz"),
                "frequency_error": (self.frequency_error, "Hz"),
                "ratio": (self.ratio, "1"),
                "ratio_error": (self.ratio_error, "1"),
                "effective_mass": (self.effective_mass, "kg"),
                "effective_mass_error": (self.effective_mass_error, "kg"),
                "stiffness": (self.stiffness, "N/m"),
            },
        )
        return found.assign_attrs(geometry=self.domain.model.name)

    def _tables(self) -> list[Table]:
        model = self.domain.model
        megahertz = zip(self.frequency * 1e-6, self.frequency_error * 1e-6, strict=True)
        nanograms = zip(self.effective_mass * 1e12, self.effective_mass_error * 1e12, strict=True)
        columns = {
            "mode": [str(number) for number in self.number],
            "label": [label or "–" for label in self.label],
            "f (MHz)": [with_error(*f) for f in megahertz],
            "f/f₁": [with_error(*r) for r in zip(self.ratio, self.ratio_error, strict=True)],
            "m_eff (ng)": [with_error(*m) for m in nanograms],
        }
        if self.first > 1:
            del columns["f/f₁"]
        title = f"{model.name}: {len(self.frequency)} modes"
        title += f" {'with' if model.bending else 'without'} bending, degree {self.degree}"
        note = NO_ERRORS if self.coarse is None else ERRORS
        return [Table(title, columns, [note])]
