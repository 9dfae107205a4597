"""Effects: physical causes that change what a stage of the simulation hands on."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from femnl.core.kinds import kinds
from femnl.core.readout import Array

Kind = str
"""Name of a kind of measurement, a key of `femnl.core.kinds.kinds()`."""
Stage = str
"""Name of a stage of a forward model, one of the `stages` of a kind."""
Values = Mapping[str, float]
ManyValues = Mapping[str, Array]
"""The same of several models at once, (m,) of each parameter."""
UNKNOWN = "unknown"
"""What no library has, among what a cause imitates."""
Change = Callable[[Any, Values], Any]
"""A pure function from the value of a stage and the parameters of the effect to a new value of the
same type.
"""


@dataclass(frozen=True)
class ParameterSpec:
    """One parameter: its unit and its prior.

    The prior is uniform on [low, high], or with `log` uniform in the logarithm.

    low and high count in `unit`, times the number of the measurement that `scale` names (such as
    "reach", half the size of the film in m). Where `strength` is set, the effect vanishes as all
    its strengths go to 0; the other parameters only shape it. With `whole`, it is the whole number
    nearest to a value in that range. reason: why nothing beyond that range is physical or can be
    told, in a phrase with its source; a fit that ends at a bound is not named as a cause.
    """

    name: str
    unit: str
    low: float
    high: float
    strength: bool = True
    log: bool = False
    scale: str = ""
    whole: bool = False
    reason: str = ""


@dataclass(frozen=True)
class EffectFile:
    """A file outside of every package that defines an effect, with the text that was read."""

    path: str
    text: bytes = field(repr=False)


@dataclass(frozen=True, eq=False)
class Effect:
    """One physical cause, as its file in `femnl/effects/` states it.

    name: as used in files. equation: in words a physicist reads. changes: by stage, see `Change`.
    needs: scales of the measurement without which the effect cannot be recognised, such as "time".
    replaces: base parameters that have no meaning beside it.
    shared: whether the measurements of one device have its parameters in common, as for film and
    stage; else each laser has its own.
    couples_blocks: whether what it does to one step, sweep or place depends on the motion at
    another.
    pointwise: whether it takes arrays of parameters: one value a point of sweeps, each of which is
    changed by what is at that point alone, or (m, 1) beside lines (m, n) of spectra of m films.
    one_material: whether its equation holds for a film of one material alone, so that films with
    layers that have a shape are diagnosed without it.
    accuracy: part of what it does to the data that its equation may miss on real devices, and why.
    imitates: by kind of measurement, the largest part of what another cause does that it takes up
    in that one's place, by the name of each where it is much, and of what no library has, under
    `UNKNOWN`; from `tests/blind/imitations.py`. Of a kind that is not in it, nothing is known.
    sentence: for the report, "the film …". source, limits: where the equation is from and how far
    it holds. file: where a file outside of every package defines it.
    """

    name: str
    equation: str
    parameters: tuple[ParameterSpec, ...]
    changes: Mapping[Stage, Change]
    source: str
    limits: str
    sentence: str
    needs: tuple[str, ...] = ()
    replaces: tuple[str, ...] = ()
    shared: bool = True
    couples_blocks: bool = False
    pointwise: bool = False
    accuracy: float = 0.01
    one_material: bool = False
    accuracy_reason: str = "parameters of the device are known to a percent at best"
    imitates: Mapping[Kind, Mapping[str, float]] = field(default_factory=dict)
    file: EffectFile | None = field(default=None, repr=False, compare=False)

    @property
    def has_strength(self) -> bool:
        """Whether it has strengths, and vanishes with them."""
        return any(spec.strength for spec in self.parameters)

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """The kinds of measurement that the effect can show in."""
        return tuple(
            spec.name
            for spec in kinds().values()
            if not self.changes.keys().isdisjoint(spec.stages)
        )
