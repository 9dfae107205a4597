"""Text tables: comma, semicolon, tab or blank separated.

A TOML beside the file says what the columns are.

The TOML has the table's name with .toml, or is named by the user. For example, for a sweep recorded
in kHz and degrees:

    kind = "response"
    rms = true
    [columns]
    frequency = { column = "f", unit = "kHz" }
    magnitude = { column = "R", unit = "mV" }
    phase = { column = "theta", unit = "deg" }
    drive = { column = "U", unit = "mV" }
    [values]
    wavelength = "632.8 nm"

Columns without heading (header = false) are numbered from 1; a clock stands for a missing column:
time = { rate = "1 MHz" }.
"""

import csv
import warnings
from collections import Counter
from collections.abc import Sequence
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io.labfiles.base import Format, Groups, need_size
from femnl.io.labfiles.columns import one_table
from femnl.io.labfiles.named_columns import is_number
from femnl.io.labfiles.spec import Spec

HEAD = 200
"""Lines of a table that its shape is read from."""
MOST_COLUMNS = 10_000
_SUFFIXES = (".csv", ".txt", ".dat", ".tsv")


def read_table(path: Path, spec: Spec) -> dict[str, NDArray[Any]]:
    """Read a text table into its columns by heading (or number from 1).

    Raises: MeasurementError.
    """
    import pandas as pd

    need_size(path, "split it")
    try:
        with warnings.catch_warnings():
            delimiter = _delimiter(path, spec)
            # Rows longer than the heading would be cut off with a warning only.
            warnings.simplefilter("error", pd.errors.ParserWarning)
            frame = pd.read_csv(
                path,
                sep=r"\s+" if delimiter == " " else delimiter,
                decimal=spec.decimal,
                skiprows=spec.skip,
                header=0 if spec.header else None,
                comment="#",
                skipinitialspace=True,
                index_col=False,
                encoding="utf-8-sig",
            )
            if spec.header:
                _refuse_odd_head(path, spec, delimiter, frame.shape[1])
    except UnicodeDecodeError:
        raise MeasurementError(f"{path}: not UTF-8 text; export it as UTF-8") from None
    except pd.errors.EmptyDataError:
        raise MeasurementError(f"{path}: holds no table; export it again") from None
    except (ValueError, csv.Error, pd.errors.ParserWarning) as error:
        raise MeasurementError(
            f"{path}: not a table ({' '.join(str(error).split())[:100]}); check delimiter, "
            "decimal and skip"
        ) from None
    names = (
        [str(name).strip() for name in frame.columns]
        if spec.header
        else [str(number + 1) for number in range(frame.shape[1])]
    )
    if spec.header and all(is_number(name) for name in names):
        raise MeasurementError(
            f"{path}: its first line holds numbers and no headings; give header = false, and "
            "columns by number"
        )
    return {name: frame.iloc[:, index].to_numpy() for index, name in enumerate(names)}


def _refuse_odd_head(path: Path, spec: Spec, delimiter: str, named: int) -> None:
    """Refuse a heading over two columns, and one of more columns than its rows have.

    The latter would shift them. Blanks within headings of a table that blanks separate do so.
    """
    with path.open(encoding="utf-8-sig") as file:
        kept = (
            line.split("#")[0].rstrip("\n")
            for number, line in enumerate(file)
            if number >= spec.skip
        )
        lines = [line for line in islice(kept, HEAD) if line.strip()]
    if len(lines) < 2:
        return
    rows = [
        line.split() if delimiter == " " else next(csv.reader([line], delimiter=delimiter))
        for line in lines
    ]
    longest = max(len(row) for row in rows[1:])
    heads = len(rows[0]) - (rows[0][-1].strip() == "")
    names = Counter(name.strip() for name in rows[0][:heads])
    doubled = sorted(name for name, count in names.items() if count > 1)
    if doubled:
        raise MeasurementError(
            f"{path}: heading {doubled[0]!r} stands over two columns; rename one"
        )
    if heads > longest:
        raise MeasurementError(
            f"{path}: the heading names {heads} columns, but rows have {longest}; quote headings "
            "that hold blanks, or give skip, header = false and columns by number"
        )


def _delimiter(path: Path, spec: Spec) -> str:
    """Return the separator that the spec names, else the one that the first line uses most.

    Raises: MeasurementError for more columns than MOST_COLUMNS, over which readers take for ever.
    """
    with path.open(encoding="utf-8-sig") as file:
        lines = (
            line
            for number, line in enumerate(file)
            if number >= spec.skip and line.strip() and not line.startswith("#")
        )
        first = next(lines, "")
    marks = (";", "\t", "," if spec.decimal == "." else "|", spec.delimiter or " ")
    counts = {mark: first.count(mark) for mark in marks}
    if max(counts.values()) > MOST_COLUMNS:
        raise MeasurementError(
            f"{path}: its first line has {max(counts.values())} columns, more than "
            f"{MOST_COLUMNS}; save each quantity as a column and each point as a row"
        )
    if spec.delimiter is not None:
        return spec.delimiter
    del counts[" "]
    best = max(counts, key=lambda mark: counts[mark])
    return best if counts[best] else " "


def _read(paths: Sequence[Path], spec: Spec) -> tuple[Groups, list[str]]:
    return one_table(paths, spec, "text table", partial(read_table, spec=spec))


FORMAT = Format("text table", lambda path: path.suffix.lower() in _SUFFIXES, _read)
