"""Published measurements whose authors say what causes them, as files that femnl diagnoses.

One TOML file each in validation/published/, discovered, never listed. A case holds the numbers as a
source prints them, in its units, with the place where they stand and the authors' own cause. Data
that are published as files of their own stay out of the repository: the case names the file, and
how to read it.

    title = "A drum of rubber in air"
    citation = "…"
    source = "https://…"              # where the numbers were read
    place = "table of Lab 1"
    form = "measured"
    geometry = "…"                    # or model = '''TOML text of a geometry'''

    [authors]
    cause = "air loading"             # in their words
    names = ["gas_loading"]           # in femnl's; [] where they find nothing beside the model
    proof = "…"

    [data]
    kind = "spectrum"
    uncertainty = "rounding"

    [data.columns]
    frequency = { values = [82.2, 158.0], unit = "Hz" }
    frequency_sd = { values = [0.03, 0.3], unit = "Hz" }
"""

import csv
import tomllib
from collections.abc import Mapping, Sequence
from datetime import datetime
from fnmatch import fnmatch
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from femnl.core.errors import MeasurementError, ParameterError
from femnl.io import measurement
from femnl.io.labfiles import import_file
from femnl.io.labfiles.spec import Spec
from femnl.io.measurement import CONTROLS, KINDS, coherent, quantity, to_si

Array = NDArray[np.float64]
SCALARS = {"pressure": "Pa"}
"""Attributes of a group that a case may give, with their units."""


class _Strict(BaseModel):
    """Unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Column(_Strict):
    """Numbers as the source prints them.

    unit: a unit, or a quantity such as "1.6858 MHz" of which the numbers are multiples.
    """

    values: list[float] = Field(min_length=1)
    unit: str = ""


class Rows(_Strict):
    """What is taken from a table of other people's measurements.

    where: column → pattern that its entry matches. columns: quantity → [heading, unit]. date:
    heading of dates, which become `time`. constants: quantity → the same value for every row.
    """

    where: dict[str, str]
    columns: dict[str, tuple[str, str]]
    date: str = ""
    constants: dict[str, str] = {}


class Data(_Strict):
    """The data of a case.

    columns: quantity → numbers, where the case itself holds them. label: of modes. multiplicity:
    how many modes the source gives one frequency for, such as the two of a round drum. file: below
    the folder of published data, read by `spec` as a lab file or by `rows` as a table. uncertainty:
    what the standard deviations are.
    """

    kind: Literal["spectrum", "series", "response", "trace"]
    uncertainty: str
    columns: dict[str, Column] = {}
    label: list[str] = []
    multiplicity: list[int] = []
    values: dict[str, str] = {}
    file: str = ""
    spec: Spec | None = None
    rows: Rows | None = None

    @model_validator(mode="after")
    def _one_source(self) -> "Data":
        """Numbers stand in the case, or in one file that is read in one way."""
        ways = [bool(self.columns), self.spec is not None, self.rows is not None]
        if sum(ways) != 1 or bool(self.file) == bool(self.columns):
            raise ValueError("give columns, or a file with one of spec and rows")
        return self


class Authors(_Strict):
    """What the authors hold to be the cause: in their words, by femnl's names, and their proof."""

    cause: str = Field(min_length=1)
    names: list[str]
    proof: str = Field(min_length=1)


class Case(_Strict):
    """A published measurement: where it is from, its numbers, and the authors' cause."""

    title: str = Field(min_length=1)
    citation: str = Field(min_length=10)
    doi: str = ""
    arxiv: str = ""
    source: str = Field(pattern=r"^https?://\S+$")
    place: str = Field(min_length=1)
    form: Literal["measured", "simulated"]
    device: str = Field(min_length=1)
    geometry: str = ""
    model: str = ""
    remark: str = ""
    authors: Authors
    data: Data


def find(folder: Path, select: Sequence[str] = ()) -> list[Path]:
    """Return the case files of a folder by name; `select` keeps names that match one of its words.

    Raises: ParameterError where a word matches no case.
    """
    paths = sorted(folder.glob("*.toml"))
    for word in select:
        if not any(fnmatch(path.stem, word) for path in paths):
            known = ", ".join(path.stem for path in paths)
            raise ParameterError(f"no published case is named {word!r}; there are: {known}")
    return [path for path in paths if not select or _selected(path, select)]


def _selected(path: Path, select: Sequence[str]) -> bool:
    return any(fnmatch(path.stem, word) for word in select)


def load(path: Path) -> Case:
    """Return the case that a file describes. Raises: ParameterError naming file and key."""
    try:
        return Case.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ParameterError(f"{path}: not TOML ({error}); correct that place") from None
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise ParameterError(f"{path}: {key}: {first['msg']}; correct it") from None


def to_measurement(case: Case, folder: Path | None = None) -> xr.DataTree:
    """Return a case as the content of a measurement file.

    Args: folder: of published data that the repository does not hold.
    Raises: MeasurementError where the data are not there or are no measurement.
    """
    root = {"title": case.title, "source": f"{case.citation} ({case.source})"}
    root |= {"model": case.model} if case.model else {}
    root |= {"geometry": case.geometry} if case.geometry else {}
    data = case.data
    if data.columns:
        return measurement.bundle({data.kind: _printed(data)}, **root)
    path = external(case, folder)
    if path is None or not path.is_file():
        raise MeasurementError(
            f"{data.file}: not in the folder of published data; get it from {case.source}"
        )
    if data.rows is not None:
        return measurement.bundle({data.kind: _from_table(path, data.rows)}, **root)
    with TemporaryDirectory() as scratch:
        tree = import_file(path, Path(scratch) / "case.nc", data.spec)
    groups = {name: node.to_dataset(inherit=False) for name, node in tree.children.items()}
    return measurement.bundle(groups, **root)


def external(case: Case, folder: Path | None) -> Path | None:
    """Return where the file of a case is, None where the case holds its numbers itself."""
    if not case.data.file or folder is None:
        return None
    return folder / case.data.file


def _printed(data: Data) -> xr.Dataset:
    """Return the numbers that a case prints, in SI, as a group of a measurement file."""
    arrays: dict[str, Any] = {}
    for name, column in data.columns.items():
        unit = _unit(data.kind, name, column.unit)
        arrays[name] = _spread(_numbers(column, unit, name), data.multiplicity)
    if data.label:
        arrays["label"] = data.label
    if data.kind == "series":
        units = {name: column.unit for name, column in data.columns.items()}
        dataset = _series(arrays, units)
    else:
        dataset = measurement.spectrum(**arrays)
    scalars = {
        name: quantity(value, SCALARS[name], f"values.{name}")[0]
        for name, value in data.values.items()
    }
    return dataset.assign_attrs(scalars)


def _numbers(column: Column, si: str, where: str) -> Array:
    """Return a column in SI; its unit may be a quantity, which its numbers are multiples of."""
    values = np.asarray(column.values, dtype=float)
    if column.unit[:1].isdigit():
        return values * quantity(column.unit, si, where)[0]
    return to_si(values, column.unit, si, where)


def _spread(values: Array, multiplicity: Sequence[int]) -> Array:
    """Return each value as often as modes share it."""
    return np.repeat(values, multiplicity) if multiplicity else values


def _from_table(path: Path, rows: Rows) -> xr.Dataset:
    """Return a series from the rows of a table that match, in the order of their dates."""
    with path.open(encoding="utf-8", newline="") as stream:
        taken = [row for row in csv.DictReader(stream) if _matches(row, rows.where)]
    if not taken:
        raise MeasurementError(f"{path}: no row matches {rows.where}; check the case")
    if rows.date:
        taken.sort(key=lambda row: row[rows.date])
    arrays = {
        name: to_si([float(row[heading]) for row in taken], unit, _unit("series", name, unit), name)
        for name, (heading, unit) in rows.columns.items()
    }
    for name, value in rows.constants.items():
        arrays[name] = np.full(len(taken), quantity(value, _unit("series", name), name)[0])
    if rows.date:
        moments = [datetime.fromisoformat(row[rows.date]) for row in taken]
        arrays["time"] = np.array([(m - moments[0]).total_seconds() for m in moments])
    return _series(arrays, {name: unit for name, (_, unit) in rows.columns.items()})


def _series(arrays: dict[str, Any], units: Mapping[str, str]) -> xr.Dataset:
    """Return the series of arrays in SI: some are quantities, all others control variables."""
    known = KINDS["series"].datasets
    free = [name for name in arrays if name not in known]
    control = {name: arrays.pop(name) for name in (*CONTROLS, *free) if name in arrays}
    own = {name: coherent(units[name], name) or "1" for name in free}
    return measurement.series(control, **arrays, units=own)


def _matches(row: Mapping[str, str], where: Mapping[str, str]) -> bool:
    return all(fnmatch(row[heading], pattern) for heading, pattern in where.items())


def _unit(kind: str, name: str, unit: str = "") -> str:
    """Return the SI unit of a column; one that the kind does not list is a control variable."""
    spec = KINDS[kind].datasets.get(name)
    if spec is not None:
        return spec.unit or ""
    if not unit or not KINDS[kind].free:
        raise MeasurementError(f"columns.{name}: not a quantity of kind {kind}")
    return coherent(unit, f"columns.{name}")
