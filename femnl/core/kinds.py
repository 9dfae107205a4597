"""Kinds of measurement: what a file of each holds, and where its model, fits and picture are.

A kind is a package of `femnl/observe` whose `__init__` defines `KIND`; a new one is found by
itself. That `__init__` imports nothing heavy, so that files are read without any model.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from types import MappingProxyType
from typing import Any

from femnl.core.errors import MeasurementError

_OBSERVE = "femnl.observe"


@dataclass(frozen=True)
class Item:
    """One dataset or scalar attribute of a measurement file.

    dims: its dimensions. unit: its SI unit, "" for a plain number, None for text. axis: values must
    rise strictly along the single dimension. coordinate: it labels the data; all else is data.
    """

    dims: tuple[str, ...] = ()
    unit: str | None = ""
    required: bool = False
    coordinate: bool = False
    axis: bool = False
    positive: bool = False


@dataclass(frozen=True)
class Contract:
    """What a group of a measurement file holds.

    dims: in the order of the file. datasets and attributes: by name. needs: of each group of names
    at least one dataset must be there. free: dimensions of further control variables, whose names
    and units a file chooses; empty where it may choose none.
    """

    dims: tuple[str, ...]
    datasets: Mapping[str, Item]
    attributes: Mapping[str, Item] = field(default_factory=dict)
    needs: tuple[tuple[str, ...], ...] = ()
    free: tuple[str, ...] = ()


@dataclass(frozen=True)
class Cost:
    """What a command takes for a group, as `python -m benchmarks.sizes` measures it.

    memory: bytes at most for each byte of numbers that the group holds, beyond `OWN`. most: numbers
    of the largest dataset of a group from which on the command takes about a quarter of an hour of
    one processor; None where memory alone is the limit.
    """

    memory: float
    most: int | None = None


@dataclass(frozen=True)
class Size:
    """How large a group may be.

    data: what one number of its largest dataset is called, in the plural. remedy: how such a
    measurement becomes smaller. show, fit, diagnose: what these commands take. together: whether a
    fit takes all groups of a file at once.
    """

    data: str = "values"
    remedy: str = "leave some out, or average neighbours"
    show: Cost = Cost(4.0)
    fit: Cost = Cost(50.0)
    diagnose: Cost = Cost(200.0)
    together: bool = False


def _default_modes(dataset: Any) -> int:
    return 12


@dataclass(frozen=True)
class KindSpec:
    """One kind of measurement, as its package in `femnl/observe` states it.

    name: as diagnoses and effects use it. stages: those whose values effects may change, in the
    order in which the model runs them. scales: names of the numbers that its models give for the
    ranges of parameters (`ParameterSpec.scale`) and for the `needs` of effects. pose and figure:
    "module:function", imported when they are called: `pose(dataset, film, checkpoint)` returns the
    `MeasurementModel` of a group, and keeps the fits that this takes in the checkpoint;
    `figure(dataset)` draws the group. contract: what a group of a file
    holds, None where the kind is a special case of another. of: that other kind, whose name the
    file gives. recognise: whether a group of the kind `of` is this special case. modes: how many
    modes of the film the model needs, from the group. needs_device: whether the model needs a film.
    places: whether the figure shows places on the film, and so takes its outline too.
    takes_layers: whether a film of one material may stand for film and layers, as it does where
    light plays no part. size: how large a group may be, so that what is too large is refused before
    it is read.
    """

    name: str
    stages: tuple[str, ...]
    scales: frozenset[str]
    pose: str
    figure: str
    contract: Contract | None = None
    of: str = ""
    recognise: Callable[[Any], bool] | None = None
    modes: Callable[[Any], int] = _default_modes
    needs_device: bool = True
    places: bool = False
    takes_layers: bool = False
    size: Size = Size()


CONTROLS: Mapping[str, str] = MappingProxyType(
    {
        "pressure": "Pa",
        "temperature": "K",
        "laser_power": "W",
        "voltage": "V",
        "drive": "V",
        "time": "s",
    }
)
"""Control variables that effects know, with their units; a file may name others."""
NOISE = Item(unit="V", positive=True)
WAVELENGTH = Item(unit="m", positive=True)
AMPLITUDE: Mapping[str, str] = MappingProxyType({"real": "V", "imag": "V"})
"""Parts of a complex amplitude, with their units."""


def label(dim: str, unit: str | None) -> Item:
    """Return the item of a coordinate along one dimension."""
    return Item((dim,), unit, coordinate=True)


@cache
def kinds() -> Mapping[str, KindSpec]:
    """Return every kind by name: the constant KIND of each package in `femnl/observe`."""
    # Found by name, since modules of this floor import none of a higher one.
    packages = [
        found.name for found in iter_modules(import_module(_OBSERVE).__path__) if found.ispkg
    ]
    specs = [import_module(f"{_OBSERVE}.{name}").KIND for name in packages]
    return MappingProxyType({spec.name: spec for spec in specs})


def contracts() -> Mapping[str, Contract]:
    """Return what each kind of group in a measurement file holds, by its kind."""
    return {spec.name: spec.contract for spec in kinds().values() if spec.contract is not None}


def kind_of(dataset: Any) -> KindSpec:
    """Return the kind of a group: the special case that recognises it, else the kind it names.

    Args: dataset: a group as read, with the attribute `kind`.
    Raises: MeasurementError for a kind that is not known.
    """
    name = str(dataset.attrs["kind"])
    for spec in kinds().values():
        if spec.of == name and spec.recognise is not None and spec.recognise(dataset):
            return spec
    if name not in kinds():
        raise MeasurementError(f"kind is {name!r}; known are {', '.join(contracts())}")
    return kinds()[name]


def function(reference: str) -> Callable[..., Any]:
    """Return the function that a text "module:name" names, and import its module."""
    module, _, name = reference.partition(":")
    found: Callable[..., Any] = getattr(import_module(module), name)
    return found
