"""What a fit of a chip says."""

from dataclasses import dataclass

from femnl.core.fit import Parameter

NAMED = 0.8
"""Probability from which on a device is named as an outlier: four to one.

Of 150 simulated chips (seeds 80000 to 80149), 171 of 175 hidden devices are named and one that is
none; with one to one, 172 and six.
"""


@dataclass(frozen=True)
class Deviation:
    """One device and mode beside what the rest of the chip predicts.

    value: as measured, in Hz or 1. predicted: by all other devices. log_ratio: ln(value/predicted),
    and sd: its standard deviation, mostly the spread from device to device. outlier: probability
    that the device deviates from the chip.
    """

    device: str
    mode: str
    design: str
    place: tuple[float, float]
    value: float
    predicted: float
    log_ratio: float
    sd: float
    outlier: float

    @property
    def sigma(self) -> float:
        """The deviation in units of its standard deviation."""
        return self.log_ratio / self.sd

    @property
    def odd(self) -> bool:
        """Whether the device is named as one that deviates."""
        return self.outlier > NAMED


@dataclass(frozen=True)
class LeftOut:
    """How well devices are predicted by the others of their chip.

    error: median of |ln(value/predicted)|. plain_error: the same by the mean of the others of the
    design. coverage: part of the 68 % intervals that hold the value. count: how many numbers.
    """

    error: float
    plain_error: float
    coverage: float
    count: int


@dataclass(frozen=True)
class Quantity:
    """Frequencies or quality factors of a chip.

    fields: probability of each form of the smooth variation. slope: relative change for a unit of
    the places, along x and y, as far as devices differ in them. peak_to_valley: of the variation,
    between the highest and the lowest device. spread: from device to device, relative. means: of
    each design and mode, in Hz or 1.
    """

    name: str
    unit: str
    fields: dict[str, float]
    slope: tuple[Parameter, ...] | None
    peak_to_valley: float
    spread: Parameter
    means: dict[str, Parameter]
    devices: tuple[Deviation, ...]
    left_out: LeftOut

    @property
    def varies(self) -> float:
        """Probability that the quantity varies smoothly over the chip."""
        return 1.0 - self.fields["none"]


@dataclass(frozen=True)
class Cause:
    """What a device deviates by, and why: a name, its probability among those tried, words."""

    device: str
    name: str
    probability: float
    words: str


@dataclass(frozen=True)
class FilmFit:
    """The film common to a chip's designs, where their geometries are known.

    causes: what makes the designs differ from the simulation of one film, with the probability of
    each set. parameters: speed of waves and what the leading set adds. residuals: ln(mean/film) of
    each design and mode, the film with the leading set. measure_next: in words.
    """

    causes: dict[str, float]
    parameters: tuple[Parameter, ...]
    residuals: dict[str, float]
    measure_next: str

    @property
    def leading(self) -> str:
        """The most probable set of causes."""
        return max(self.causes, key=lambda name: self.causes[name])


@dataclass(frozen=True)
class ChipFit:
    """A chip: what its devices share, how they vary over it, and which deviate, and why."""

    name: str
    devices: int
    place_unit: str
    frequency: Quantity
    quality: Quantity | None
    causes: tuple[Cause, ...]
    film: FilmFit | None
    notes: tuple[str, ...]
