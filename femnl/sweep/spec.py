"""Sweep files: which values of a geometry vary, how, and what is asked of every device."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from femnl.core.choices import Symmetry
from femnl.core.errors import ParameterError, one_line, suggest
from femnl.core.memory import need_memory
from femnl.core.toml import parse_toml, read_toml
from femnl.device.geometry import load
from femnl.sweep.axes import KIND, Axis, Range, check_axis, locate, put, read_axis
from femnl.sweep.point import KEPT, Point, Settings, Tables

MOST = 1_000_000
"""More points than this are taken for a mistake."""
QUICKEST = 0.2
"""Seconds that the simplest of devices takes, at least."""
LINE = 1500
"""Bytes that a point takes in the store, about."""
HELD = 10_000
"""Bytes of memory that a record takes in the client, about."""


class Strict(BaseModel):
    """Unknown keys are errors, and values have exactly the declared types."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class SampleTable(Strict):
    """How ranges are sampled: `points` points by `method`, quasi-random by a seed."""

    points: Annotated[int, Field(ge=1)]
    method: Literal["sobol", "halton", "latin-hypercube"] = "sobol"
    seed: Annotated[int, Field(ge=0, lt=2**63)] | None = None


class SpecFile(Strict):
    """A sweep file. axis: each a table of values that vary together.

    The sweep is their product, or a sample of their ranges.
    """

    geometry: str
    modes: Annotated[int, Field(ge=1, le=1000)] = 6
    resolution: Annotated[float, Field(ge=0.1, le=20)] = 1.0
    symmetry: str = "auto"
    keep: Annotated[list[str], Field(min_length=1)] = ["frequency", "ratio", "alpha"]
    axis: Annotated[list[dict[str, Any]], Field(min_length=1, max_length=32)]
    sample: SampleTable | None = None


@dataclass(frozen=True)
class Sweep:
    """A sweep ready to run. name: of its geometry; base: the geometry's tables.

    sample: None for the product of the axes.
    """

    name: str
    base: Tables
    settings: Settings
    axes: tuple[Axis, ...]
    sample: SampleTable | None

    @property
    def count(self) -> int:
        """How many points there are."""
        return self.sample.points if self.sample else math.prod(axis.points for axis in self.axes)

    @property
    def paths(self) -> tuple[str, ...]:
        """Everything that varies, such as "film.stress"."""
        return tuple(path for axis in self.axes for path in axis.values)

    def points(self, seed: int) -> Iterator[Point]:
        """Every point, in the order of the file, the last axis fastest.

        seed: of the sample, without meaning for a product.
        """
        if self.sample is None:
            for places in product(*(range(axis.points) for axis in self.axes)):
                yield self._point(
                    {
                        path: v
                        for axis, k in zip(self.axes, places, strict=True)
                        for path, v in axis.at(k).items()
                    }
                )
        else:
            from femnl.sweep.sample import draw

            for place in draw(self.sample.method, self.sample.points, len(self.axes), seed):
                yield self._point(
                    {
                        path: v
                        for axis, u in zip(self.axes, place, strict=True)
                        for path, v in axis.within(u).items()
                    }
                )

    def _point(self, varied: dict[str, Any]) -> Point:
        return Point(put(self.base, varied), varied)


def read_sweep(path: Path) -> Sweep:
    """Read and check a sweep file.

    Args: path: of the TOML file, beside which its geometry is looked for where that is no shipped
    one.
    Raises: ParameterError, GeometryError: one line that names file, key, value and remedy.
    """
    spec = _read(path)
    beside = path.parent / spec.geometry
    model = load(beside if beside.is_file() else spec.geometry)
    try:
        settings = _settings(spec)
        sweep = Sweep(
            model.name,
            parse_toml(model.text),
            settings,
            tuple(read_axis(table) for table in spec.axis),
            spec.sample,
        )
        _check(sweep, spec, model.bending)
    except ParameterError as error:
        raise ParameterError(one_line(f"{path}: {error}")) from None
    return sweep


def _read(path: Path) -> SpecFile:
    try:
        return SpecFile.model_validate(read_toml(path))
    except OSError as error:
        raise ParameterError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in first["loc"])
        known = (
            [*SampleTable.model_fields] if key.startswith("sample.") else [*SpecFile.model_fields]
        )
        if first["type"] == "extra_forbidden":
            raise ParameterError(
                one_line(f"{path}: {key}: unknown key, {suggest(key.split('.')[-1], known)}")
            ) from None
        if first["type"] == "missing":
            raise ParameterError(
                f"{path}: {key} is missing; examples/design-study.toml shows a whole sweep file"
            ) from None
        reason = (
            first["msg"]
            .replace("Input should be", "expected")
            .replace("Value should have", "expected")
        )
        raise ParameterError(
            one_line(f"{path}: {key} = {str(first['input'])[:60]}: {reason}")
        ) from None
    except ValueError as error:
        raise ParameterError(
            one_line(f"{path}: not TOML ({error}); text and quantities stand in quotes")
        ) from None


def _settings(spec: SpecFile) -> Settings:
    for name in spec.keep:
        if name not in KEPT:
            raise ParameterError(f'keep = "{name}": unknown result, {suggest(name, [*KEPT])}')
    known = ("auto", *get_args(Symmetry))
    if spec.symmetry not in known:
        raise ParameterError(f'symmetry = "{spec.symmetry}": expected one of {", ".join(known)}')
    return Settings(
        spec.modes,
        spec.resolution,
        spec.symmetry,
        tuple(name for name in KEPT if name in spec.keep),
    )


def _check(sweep: Sweep, spec: SpecFile, bending: bool) -> None:
    """Refuse a sweep that cannot be meant, before any point is solved."""
    for path in sweep.paths:
        try:
            locate(sweep.base, path)
        except KeyError:
            known = sorted(_leaves(sweep.base))
            raise ParameterError(
                f"axis {path}: the geometry {spec.geometry} gives no such value; "
                f"{suggest(path, known)}"
            ) from None
    if "dilution" in spec.keep and not bending and "model.bending" not in sweep.paths:
        raise ParameterError(
            f'keep = "dilution": {spec.geometry} has bending = false, which leaves nothing that '
            "loses energy; set it true"
        )
    if len(set(sweep.paths)) < len(sweep.paths):
        twice = next(path for path in sweep.paths if sweep.paths.count(path) > 1)
        raise ParameterError(f"axis {twice}: two axes vary it; leave one of them out")
    for axis in sweep.axes:
        ranges = all(
            isinstance(values, Range) and values.points is None for values in axis.values.values()
        )
        first = next(iter(axis.values))
        if sweep.sample is not None and not ranges:
            raise ParameterError(
                f'axis {first}: a sample needs ranges, write {first} = {{from = "…", to = "…"}}, '
                "or leave [sample] out"
            )
        if sweep.sample is None and any(
            isinstance(values, Range) and values.points is None for values in axis.values.values()
        ):
            raise ParameterError(
                f"axis {first}: its range gives no points; write points = 5, or sample all ranges "
                "with a table [sample]"
            )
    if sweep.count > MOST:
        what = (
            f"sample.points = {sweep.count}"
            if sweep.sample
            else " × ".join("+".join(axis.values) for axis in sweep.axes)
        )
        years = sweep.count * QUICKEST / 3.156e7
        raise ParameterError(
            f"{what}: {sweep.count:,} points would take at least {years:,.2g} years of one "
            f"processor and {sweep.count * LINE / 2**30:,.0f} "
            f"GiB for results; expected at most {MOST:,}, take fewer values or a table [sample]"
        )
    need_memory(
        HELD * sweep.count,
        f"results of {sweep.count:,} points",
        "take fewer values or a table [sample]",
    )
    for axis in sweep.axes:
        check_axis(axis, sweep.base)


def _leaves(tables: Any, before: str = "") -> Iterator[str]:
    """Yield the paths of values that may be varied, those in lists of tables counted from 1."""
    for key, value in tables.items():
        several = isinstance(value, list) and all(isinstance(one, dict) for one in value)
        if isinstance(value, dict):
            yield from _leaves(value, f"{before}{key}.")
        elif several:
            for number, one in enumerate(value, start=1):
                yield from _leaves(one, f"{before}{key}.{number}.")
        elif before and key != KIND:
            yield before + key
