"""The study file of a chip: its keys."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from femnl.core.errors import ParameterError, one_line, suggest
from femnl.core.toml import read_toml


class Strict(BaseModel):
    """Unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Columns(Strict):
    """Names of the columns of a table; those that a table does not have are left out."""

    device: str = "device"
    mode: str = "mode"
    frequency: str = "frequency"
    frequency_sd: str = "frequency_sd"
    quality_factor: str = "quality_factor"
    quality_factor_sd: str = "quality_factor_sd"
    design: str = "design"
    x: str = "x"
    y: str = "y"


class Table(Strict):
    """A table of numbers: CSV with a head, in SI units.

    chip: how the names of the devices begin that are on this chip; the rest of the name is kept.
    """

    file: str
    chip: str = ""
    columns: Columns = Columns()


class Positions(Strict):
    """Places read from the devices' names: a regular expression with the groups x and y."""

    pattern: str
    pitch: str | float = 1.0


class Mode(Strict):
    """One mode of a device."""

    mode: str = "1"
    frequency: str | float
    frequency_sd: str | float = 0.0
    quality_factor: float | None = None
    quality_factor_sd: float = 0.0


class Device(Strict):
    """One device: numbers, or a measurement file with spectra, responses or decays."""

    name: str
    design: str = ""
    position: Annotated[list[str | float], Field(min_length=2, max_length=2)] | None = None
    measurement: str | None = None
    modes: list[Mode] = []


class Design(Strict):
    """A design; geometry: a name or a file beside the study, for the film's own numbers."""

    geometry: str


class StudyFile(Strict):
    """A study file."""

    name: str
    table: Table | None = None
    positions: Positions | None = None
    design: dict[str, Design] = {}
    device: list[Device] = []


_TABLES: Mapping[str, type[Strict]] = MappingProxyType(
    {
        "": StudyFile,
        "table": Table,
        "table.columns": Columns,
        "positions": Positions,
        "device": Device,
        "device.modes": Mode,
    }
)
"""Tables of a study file, by the keys above theirs."""


def _known(above: Sequence[str | int]) -> list[str]:
    """Return the keys of a table, by the keys above them; those of [design.NAME] have any NAME."""
    path = ".".join(part for part in above if isinstance(part, str))
    return [*_TABLES.get(path, Design).model_fields]


def parse(path: Path) -> StudyFile:
    """Read a study file without what it names."""
    try:
        return StudyFile.model_validate(read_toml(path))
    except OSError as error:
        raise ParameterError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in first["loc"])
        # Of a number or a text, pydantic tells of the text first, also where a number is NaN
        if isinstance(first["input"], float) and not math.isfinite(first["input"]):
            key = key.removesuffix(".str")
            raise ParameterError(
                one_line(f"{path}: {key}: {first['input']} is no finite number")
            ) from None
        if first["type"] == "extra_forbidden":
            hint = suggest(str(first["loc"][-1]), _known(first["loc"][:-1]))
            raise ParameterError(one_line(f"{path}: {key}: unknown key, {hint}")) from None
        raise ParameterError(one_line(f"{path}: {key}: {first['msg']}")) from None
    except ValueError as error:
        raise ParameterError(one_line(f"{path}: is no TOML ({error}); mend this line")) from None
