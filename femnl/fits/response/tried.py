"""Models of a response that are fitted to the same sweeps, to be chosen from.

Which are tried, and from where each starts; `femnl.fits.response.choice` compares them.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from femnl.core.choices import Background, Use
from femnl.fits.response.candidate import Candidate
from femnl.fits.response.circle import circle_starts
from femnl.fits.response.limits import Bounds, limits
from femnl.fits.response.linear import linear_starts
from femnl.fits.response.solve import solve
from femnl.fits.response.variant import TERMS, Delay, Variant, carried
from femnl.observe.response.sweeps import Array, Sweeps
from femnl.observe.response.theta import Layout

ADEQUATE = 1.3
"""χ²/ν up to which a linear start is not followed by the full search for folds."""
SLIGHT = 0.05
"""Residual over signal, both r.m.s., up to which likewise: a jump is missed by more."""
ROUNDS = 3
"""In which background and delay are chosen in turn."""
UNFOLDED = 0.7
"""Of the χ² of the richest linear model: what leaves more is no response with a jump."""
SHARE = 0.3
"""Of the median magnitude: the background from which a fit to magnitudes starts."""


@dataclass(frozen=True)
class Asked:
    """What a user asks of a fit; None and auto leave it to the evidence.

    bounds and fixed: by parameter name, in SI.
    """

    background: Background | Literal["auto"] = "auto"
    duffing: bool | None = None
    delay: bool | None = None
    phase_sign: int | None = None
    bounds: Bounds = field(default_factory=dict)
    fixed: Mapping[str, float] = field(default_factory=dict)


def scale_of(sweeps: Sweeps, found: Iterable[Candidate]) -> float:
    """Return s², see `femnl.fits.response.choice`."""
    least = min(found, key=lambda one: one.chi2_reduced).effective
    return max(least, np.finfo(float).tiny) if sweeps.estimated else max(least, 1.0)


@dataclass
class TriedModels:
    """Fits of models to the same sweeps, those made so far by their variant in `found`.

    across_folds: whether Duffing models were sought across folds.
    """

    sweeps: Sweeps
    like: Layout
    use: Use
    asked: Asked
    found: dict[Variant, Candidate] = field(default_factory=dict)
    across_folds: bool = False

    @property
    def least(self) -> float:
        """The least χ² so far."""
        return min(one.chi2 for one in self.found.values())

    @property
    def quiet(self) -> bool:
        """Whether some model leaves little more than the noise."""
        return min(one.chi2_reduced for one in self.found.values()) < ADEQUATE

    @property
    def met(self) -> bool:
        """Whether some model leaves the noise, or a hardly visible part of the signal: no jump."""
        return self.quiet or self.least < SLIGHT**2 * self._signal

    @cached_property
    def _signal(self) -> float:
        """The power of the data [σ²] beside a constant and a leak at each position."""
        found = 0.0
        for p in range(self.sweeps.n_positions):
            at = self.sweeps.position == p
            volts = self.sweeps.voltage[at] / self.sweeps.noise
            behind = np.stack([np.ones(len(volts)), self.sweeps.drive[at]], axis=1)
            taken = behind @ np.linalg.lstsq(behind, volts, rcond=None)[0]
            found += float(np.sum(np.abs(volts - taken) ** 2))
        return found

    def cheapest(self, *, duffing: bool) -> Candidate | None:
        """Return the model of the least criterion among those with, or without, a Duffing term."""
        some = [one for one in self.found.values() if one.variant.duffing == duffing]
        scale = scale_of(self.sweeps, some) if some else 1.0
        return min(some, key=lambda one: one.criterion(scale)) if some else None

    def fit(self, variant: Variant, first: Sequence[Array], *, search: bool = False) -> Candidate:
        """Fit one model from given starts, and where `search` from all others as well."""
        layout = variant.layout(self.like)
        allowed = limits(layout, self.asked.bounds, self.asked.fixed, variant.free(layout))
        misfit, theta = solve(self.sweeps, layout, self.use, allowed, first, only_first=not search)
        residual = misfit.residual(theta)
        chi2 = float(np.sum(residual**2))
        one = Candidate(variant, misfit, theta, allowed, chi2, len(residual))
        kept = self.found.get(variant)
        if kept is None or chi2 < kept.chi2:
            self.found[variant] = one
        return self.found[variant]

    def linear(self, variant: Variant) -> Candidate:
        """Fit a linear model to complex data, where that is not done."""
        if variant in self.found:
            return self.found[variant]
        layout = variant.layout(self.like)
        return self.fit(variant, linear_starts(self.sweeps, layout, late=variant.delay != "none"))

    def again(self, variant: Variant, near: Candidate) -> Candidate:
        """Fit a model from the solution of another one, where that is not done."""
        if variant in self.found:
            return self.found[variant]
        start = carried(near.theta, near.misfit.layout, variant.layout(self.like))
        return self.fit(variant, [start])

    @property
    def forms(self) -> list[Background]:
        """Backgrounds to choose from, the simplest first."""
        return list(TERMS) if self.asked.background == "auto" else [self.asked.background]

    @property
    def late(self) -> Delay:
        """The most general delay that is allowed."""
        return "all" if self.like.phase and self.asked.delay is not False else "none"

    @property
    def _drives(self) -> bool:
        """Whether there are several drives, with which a background may grow."""
        return np.unique(self.sweeps.drive).size > 1

    def begin(self) -> bool:
        """Fit the model that decides on the sign of the phase; return whether the data are met.

        It is the richest linear model for complex data, with a background that grows with the drive
        where that describes them better, and the plain one with the full search for others.
        """
        if self.use == "complex":
            self.linear(Variant(self.forms[-1], False, self.late, duffing=False))
            if self.late == "all" and self.forms[-1] != "none" and not self.quiet:
                self.linear(Variant(self.forms[-1], False, "resonance", duffing=False))
            if self._drives and self.forms[-1] != "none" and not self.quiet:
                late: Delay = "resonance" if self.late == "all" else "none"
                self.linear(Variant(self.forms[-1], True, late, duffing=False))
        else:
            duffing = self.asked.duffing is not False
            self.fit(Variant("none", False, self.late, duffing), [], search=True)
        return self.met

    def fit_across_folds(self) -> None:
        """Fit Duffing models across folds, until one meets the data.

        The full search for starts is made without a background; the backgrounds follow from what it
        finds, and have a full search of their own only where that is hardly better than a linear
        model. The search that decided on the sign of the phase is not made again.
        """
        if self.asked.duffing is False or self.use != "complex" or self.across_folds:
            return
        self.across_folds = True
        linear = min(
            (one.chi2 for one in self.found.values() if not one.variant.duffing), default=np.inf
        )
        last: Candidate | None = None
        for form in self.forms:
            variant = Variant(form, False, self.late, duffing=True)
            layout = variant.layout(self.like)
            starts = linear_starts(self.sweeps, layout, late=False)[:1]
            if last is not None:
                starts.append(carried(last.theta, last.misfit.layout, layout))
            searched = form == "constant" and last is not None and last.chi2 > UNFOLDED * linear
            last = self.fit(variant, starts, search=last is None or searched)
            if self.met or (form == "constant" and last.chi2 > UNFOLDED * linear):
                return

    @property
    def _of_circle(self) -> Variant:
        """The model whose fit starts from a circle."""
        late: Delay = "resonance" if self.late == "all" else "none"
        return Variant(self.forms[-1], self._drives, late, duffing=True)

    @property
    def quiet_on_circle(self) -> bool:
        """Whether the model from a circle leaves least, and little more than the noise."""
        one = self.found.get(self._of_circle)
        return one is not None and one.chi2_reduced < ADEQUATE and one.chi2 == self.least

    def fit_on_circle(self) -> None:
        """Fit a Duffing model beside a background that grows with the drive, from its circle."""
        if self.asked.duffing is False or self.use != "complex" or self.forms[-1] == "none":
            return
        variant = self._of_circle
        if variant in self.found:
            return
        starts = circle_starts(self.sweeps, variant.layout(self.like))
        if starts:
            self.fit(variant, starts)

    def fit_complex(self) -> None:
        """Fit all models that may be chosen to complex data."""
        self.begin()
        rich = min(
            (one for one in self.found.values() if not one.variant.duffing),
            key=lambda one: one.chi2,
        )
        if self.asked.duffing is False:
            self._vary(rich, duffing=False)
            return
        if self.met and not self._folded(rich):
            self._vary(rich, duffing=False)
            likely = [self.cheapest(duffing=False) or rich, rich]
            for one in likely:
                self.again(replace(one.variant, duffing=True), one)
        else:
            self.fit_on_circle()
            if not self.met:
                self.fit_across_folds()
        self._vary(self.cheapest(duffing=True) or rich, duffing=True)
        best = self.cheapest(duffing=True)
        if best is not None:
            # Its linear twin, so that the two differ in nothing else
            self.again(replace(best.variant, duffing=False), best)
        if self.asked.duffing:
            linear = [one for one in self.found if not one.duffing]
            for variant in linear:
                del self.found[variant]

    def _folded(self, rich: Candidate) -> bool:
        """Whether a Duffing model was fitted already because the linear one misses a jump."""
        other = self.cheapest(duffing=True)
        return other is not None and other.chi2 < rich.chi2

    def _vary(self, near: Candidate, *, duffing: bool) -> None:
        """Fit backgrounds and delays in turn, each with the best of the other so far.

        Backgrounds that grow with the drive come last.
        """

        def fit(form: Background, delay: Delay, *, driven: bool = False) -> None:
            variant = Variant(form, driven, delay, duffing)
            if duffing or driven:
                self.again(variant, near)
            else:
                self.linear(variant)

        form = near.variant.background
        delay = near.variant.delay
        for _ in range(ROUNDS):
            for other in self.forms:
                fit(other, self._alike(delay, other))
            form = (self.cheapest(duffing=duffing) or near).variant.background
            for late in self._delays(form):
                fit(form, late)
            best = self.cheapest(duffing=duffing) or near
            if best.variant.delay == delay:
                break
            delay = best.variant.delay
        if self._drives:
            near = self.cheapest(duffing=duffing) or near
            for other in self.forms:
                if other != "none":
                    fit(other, near.variant.delay, driven=True)

    def _alike(self, delay: Delay, form: Background) -> Delay:
        """Return the delay for another background: without any, one delay is as good as another."""
        return "all" if form == "none" and delay == "resonance" else delay

    def _delays(self, form: Background) -> list[Delay]:
        """Return the delays that are allowed with a background."""
        if self.late == "none":
            return ["none"]
        found: list[Delay] = [] if self.asked.delay else ["none"]
        return [*found, "all"] if form == "none" else [*found, "all", "resonance"]

    def fit_partial(self) -> None:
        """Fit all models to magnitudes, or the plain one to phases, which hide a background."""
        if self.use != "magnitude":
            return
        for duffing in (True, False):
            if self.asked.duffing in (None, duffing):
                for form in self.forms:
                    self._behind_magnitude(Variant(form, False, "none", duffing))
        if "none" not in self.forms:
            del self.found[Variant("none", False, "none", self.asked.duffing is not False)]

    def _behind_magnitude(self, variant: Variant) -> None:
        """Fit a background to magnitudes: a constant one from several phases."""
        layout = variant.layout(self.like)
        near = min(self.found.values(), key=lambda one: one.chi2)
        start = carried(near.theta, near.misfit.layout, layout)
        starts = [start]
        size = SHARE * float(np.median(np.abs(self.sweeps.voltage)))
        for turn in (1, 1j, -1, -1j) if variant.background == "constant" else ():
            other = start.copy()
            other[layout.backgrounds.start :: 2] = (size * turn).real
            other[layout.backgrounds.start + 1 :: 2] = (size * turn).imag
            starts.append(other)
        self.fit(variant, starts)
