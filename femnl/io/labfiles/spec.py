"""The small TOML file that says what the columns of a lab's file are."""

from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from femnl.core.errors import MeasurementError, suggest
from femnl.core.toml import read_toml


class Strict(BaseModel):
    """Unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Column(Strict):
    """Where a quantity comes from.

    It is a column by its heading or number (from 1), several of them side by side, one a sweep, or
    an even clock of the given rate.

    unit: of the column (default SI; a magnitude may be in dBm, dBV or dB); offset: what is added,
    such as the centre "1.5 MHz" of a column of shifts; round: a step such as "1 um" that read-back
    positions are rounded to.
    """

    column: str | int | list[str | int] | None = None
    offset: str | None = None
    unit: str | None = None
    rate: str | None = None
    round: str | None = None


class File(Strict):
    """Which harmonic and which part of the amplitude one of several files holds."""

    name: str
    harmonic: int = Field(ge=1)
    part: Literal["real", "imag", "magnitude", "phase"] = "real"


class Spec(Strict):
    """What a lab's file holds.

    kind: of measurement. columns: quantity → column; values: what the file does not hold, one
    number (or text with unit) or one a sweep. rms: amplitudes are root mean square, so multiplied
    by √2. header, delimiter, decimal, skip: how a text table is written.
    clockbase: rate of an instrument's time stamps. signal: which of several recorded signals.
    files: parts of a map.
    """

    kind: Literal["spectrum", "response", "map", "trace", "series", "decay"] | None = None
    name: str = Field(default="measurement", pattern=r"^\w[\w.-]{0,59}$")
    geometry: str | None = None
    title: str | None = None
    sample: str | None = None
    columns: dict[str, Column | str | int] = {}
    values: dict[str, float | str | list[float | str]] = {}
    rms: bool | None = None
    header: bool = True
    delimiter: str | None = Field(default=None, min_length=1, max_length=1)
    decimal: Literal[".", ","] = "."
    skip: int = Field(default=0, ge=0)
    clockbase: str | None = None
    signal: str | None = None
    files: list[File] = []

    def column(self, quantity: str) -> Column:
        """Return where `quantity`, a key of `columns`, comes from."""
        given = self.columns[quantity]
        return given if isinstance(given, Column) else Column(column=given)


def read_spec(path: Path) -> Spec:
    """Read the TOML file. Raises: MeasurementError naming file and key."""
    try:
        return Spec.model_validate(read_toml(path))
    except OSError as error:
        raise MeasurementError(
            f"{path}: cannot be read ({error.strerror}); check the path"
        ) from None
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"] if part != "Column")
        if first["type"] == "extra_forbidden":
            known = [*(Column if key.startswith("columns.") else Spec).model_fields]
            word = key.rpartition(".")[2]
            raise MeasurementError(f"{path}: {key}: unknown key, {suggest(word, known)}") from None
        raise MeasurementError(
            f"{path}: {key} = {str(first['input'])[:40]!r}: {first['msg']}; correct it or "
            "leave it out"
        ) from None
    except ValueError as error:
        raise MeasurementError(f"{path}: not TOML ({error}); correct that place") from None
